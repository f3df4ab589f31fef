"""What a diagnosis writes: verdict, report, corrected model, and the experiments that would tell more."""

from __future__ import annotations

from pathlib import Path

from diagnosis.diagnose import Diagnosis
from diagnosis.library.registry import LIBRARY
from diagnosis.report.page import page
from spot_model.errors import BadInputError
from spot_model.model_file import save_model
from spot_model.velocity_sequence import save_sequence


def write_all(result: Diagnosis, out: Path) -> dict[str, Path]:
    """Write everything into a folder.

    Raises:
        BadInputError: The folder holds a verdict already.
    """
    paths = {
        "verdict": out / "verdict.json", "report": out / "report.html", "model": out / "corrected_model.yaml",
    }  # fmt: skip
    for path in paths.values():
        if path.exists():
            raise BadInputError(f"{path} exists; choose another folder with --out")
    (out / "experiments").mkdir(parents=True, exist_ok=True)
    paths["verdict"].write_text(result.verdict.to_json(), encoding="utf-8")
    save_model(result.corrected, paths["model"])
    for effect in result.verdict.effects:
        if effect.split is not None and effect.name in LIBRARY:
            file = out / effect.split.sequence_file
            if not file.exists():
                save_sequence(LIBRARY[effect.name].split_by.sequence, file)
    paths["report"].write_text(page(result), encoding="utf-8")
    return paths
