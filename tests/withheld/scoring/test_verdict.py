"""What the judge reads is what the diagnosis writes."""

from pathlib import Path

import pytest

from diagnosis.document import (
    CalibratedNumber,
    Calibration,
    Consequences,
    Difference,
    Number,
    QuantityChange,
    Shrink,
    UnknownEffect,
    Verdict,
)
from spot_model.errors import BadInputError
from withheld.outcome import Consequences as True_
from withheld.outcome import read_verdict

CHANGE = QuantityChange(quantity="top_speed", title="top speed", unit="m/s", before=2.0, after=1.8)
NUMBER = Number(value=0.8, low=0.7, high=0.9)
WRITTEN = Verdict(
    status="partly_explained",
    where=(),
    differences=(
        Difference(
            name="torque_gain",
            probability=0.9,
            group=("torque_gain", "load_friction"),
            joints=("fl_kn",),
            split_by="",
            parameters={"gain": NUMBER},
            by_type={"kn": {"gain": NUMBER}},
            rivals={"load_friction": 0.2},
            consequences=Consequences(loop="closed", changes=(CHANGE,)),
        ),
    ),
    calibration=Calibration(
        numbers=(
            CalibratedNumber(
                effect="torque_gain",
                parameter="gain",
                title="torque gain",
                where="kn",
                nominal=1.0,
                value=0.86,
                low=0.85,
                high=0.87,
                stands_out=True,
            ),
        )
    ),
    probability_none=0.05,
    probability_unknown=0.7,
    unknown=UnknownEffect(joints=(), regime="", channel="base_wrench", unit="N·m", left=3.0, usual=1.0),
    channels={},
    shrink=Shrink(d0=5.0, d1=1.5, floor=1.0, s=0.875, s_low=0.8, s_high=0.9, held_out=()),
    log_advice=(),
)


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
