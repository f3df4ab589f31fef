"""What the judge reads is what the diagnosis writes."""

from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from tests.diagnosis.report_case import verdict
from withheld.outcome import Consequences as True_
from withheld.outcome import read_verdict

WRITTEN = verdict((), probability_unknown=0.7)


def test_every_field_that_is_scored_is_read(tmp_path: Path) -> None:
    file = tmp_path / "verdict.json"
    file.write_text(WRITTEN.to_json())
    read, written = read_verdict(file).model_dump(by_alias=True), WRITTEN.model_dump(by_alias=True)
    assert _changed(read, written) == []
    assert read_verdict(file).is_unknown


def _changed(read: object, written: object, path: str = "") -> list[str]:
    """Where what was read lacks in what was written, or differs."""
    if isinstance(read, dict) and isinstance(written, dict):
        return [p for k, v in read.items() for p in _changed(v, written.get(k), f"{path}.{k}")]
    if isinstance(read, (list, tuple)) and isinstance(written, (list, tuple)):
        return [p for a, b in zip(read, written, strict=True) for p in _changed(a, b, f"{path}[]")]
    return [] if read == written else [path]


def test_a_verdict_of_another_schema_cannot_be_scored(tmp_path: Path) -> None:
    file = tmp_path / "verdict.json"
    file.write_text(WRITTEN.to_json().replace("verdict/2", "verdict/1"))
    with pytest.raises(BadInputError, match="cannot be scored"):
        read_verdict(file)


def test_true_consequences_are_named_as_stated_ones() -> None:
    assert {"top_speed", "mean_speed", "power", "fall_share"} == True_.model_fields.keys()
