"""What a diagnosis writes: verdict, report, corrected model, and the experiments that would tell more."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkdtemp

from diagnosis.library.base import LibraryEffect
from diagnosis.report.effect_file import FILE, effect_source
from diagnosis.report.page import page
from diagnosis.verdict.diagnose import Diagnosis
from spot_model.errors import BadInputError
from spot_model.io.model_file import save_model
from spot_model.io.velocity_sequence import save_sequence
from spot_model.io.whole import check_writable
from spot_model.robot.facts import JOINT_NAMES

NAMES = {
    "verdict": "verdict.json",
    "report": "report.html",
    "model": "corrected_model.yaml",
    "posterior": "posterior.json",
}


def check_free(out: Path) -> None:
    """Refuse a folder that holds a diagnosis already, before any work is done.

    Raises:
        BadInputError: It does, or is no folder.
        OSError: It may not be written to.
    """
    if out.exists() and not out.is_dir():
        raise BadInputError(f"--out {out} is a file; give a folder")
    for name in (*NAMES.values(), FILE):
        if (out / name).exists():
            raise BadInputError(f"{out / name} exists; choose another folder with --out")
    check_writable(out)


def write_all(result: Diagnosis, out: Path, library: Mapping[str, LibraryEffect]) -> dict[str, Path]:
    """Write everything into a folder; an interruption leaves nothing half-written there.

    Args:
        result: The diagnosis.
        out: The folder.
        library: The effects that were tried: theirs are the experiments.

    Raises:
        BadInputError: The folder holds a verdict already.
    """
    check_free(out)
    out.mkdir(parents=True, exist_ok=True)
    part = Path(mkdtemp(prefix=".part-", dir=out))
    try:
        names = _write(result, part, library)
        for file in sorted(p for p in part.rglob("*") if p.is_file()):
            place = out / file.relative_to(part)
            if not place.exists():
                place.parent.mkdir(exist_ok=True)
                file.replace(place)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return {key: out / name for key, name in names.items()}


def _write(result: Diagnosis, part: Path, library: Mapping[str, LibraryEffect]) -> dict[str, str]:
    names = dict(NAMES)
    (part / names["report"]).write_text(page(result), encoding="utf-8")
    if result.board.robot.joint_names == JOINT_NAMES:
        save_model(result.corrected, part / names["model"])
    else:
        # A model file describes Spot; of another robot the verdict's parameters are the result.
        del names["model"]
    if result.posterior is not None:
        text = result.posterior.model_dump_json(by_alias=True, indent=1)
        (part / names["posterior"]).write_text(text + "\n", encoding="utf-8")
    else:
        del names["posterior"]
    for effect in result.verdict.effects:
        if effect.split is not None and effect.split.sequence_file and effect.name in library:
            file = part / effect.split.sequence_file
            file.parent.mkdir(exist_ok=True)
            if not file.exists():
                save_sequence(library[effect.name].split_by.sequence, file)
    source = effect_source(result.verdict.unknown) if result.verdict.unknown is not None else None
    if source is not None:
        (part / FILE).write_text(source, encoding="utf-8")
    (part / names["verdict"]).write_text(result.verdict.to_json(), encoding="utf-8")
    return names
