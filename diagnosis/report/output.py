"""What a diagnosis writes: verdict, report, corrected model, and the experiments that would tell more."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from diagnosis.library import LibraryEffect
from diagnosis.report.page import page
from diagnosis.verdict.diagnose import Diagnosis
from spot_model.io.model_file import save_model
from spot_model.io.models_file import save_models
from spot_model.io.velocity_sequence import save_sequence
from spot_model.io.whole import check_new, whole_folder
from spot_model.robot.facts import JOINT_NAMES

NAMES = {
    "verdict": "verdict.json",
    "report": "report.html",
    "model": "corrected_model.yaml",
    "robots": "possible_robots.yaml",
    "robot": "corrected_robot.yaml",
    "mjcf": "corrected_robot.xml",
}


def check_no_diagnosis(out: Path) -> None:
    """Refuse a folder that holds a diagnosis already, before any work is done.

    Raises:
        OutputExistsError: It does.
        OSError: It is no folder, or may not be written to.
    """
    check_new(*(out / name for name in NAMES.values()))


def write_all(
    result: Diagnosis, out: Path, library: Mapping[str, LibraryEffect], files: Mapping[str, str] = MappingProxyType({})
) -> dict[str, Path]:
    """Write everything into a folder; an interruption leaves nothing half-written there.

    The experiments are those of the library's effects; ``files`` are texts to write as well, by name. Returned are all
    places by :data:`NAMES`.

    Raises:
        OutputExistsError: The folder holds one of the files already; none is written then.
    """
    v = result.verdict
    texts = {NAMES["report"]: page(result), NAMES["verdict"]: v.to_json(), **files}
    with whole_folder(out) as part:
        for name, text in texts.items():
            (part / name).write_text(text, encoding="utf-8")
        if result.board.robot.joint_names == JOINT_NAMES:
            # A model file describes Spot; another robot has files of its own.
            save_model(result.corrected, part / NAMES["model"])
            save_models((result.corrected, *result.possible), part / NAMES["robots"])
        for d in v.differences:
            if d.split is not None and d.split.sequence_file and d.name in library:
                file = part / d.split.sequence_file
                file.parent.mkdir(exist_ok=True)
                if not file.exists():
                    save_sequence(library[d.name].split_by.sequence, file)
        return {key: out / name for key, name in NAMES.items() if (part / name).exists()}
