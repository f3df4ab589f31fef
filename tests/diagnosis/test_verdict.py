import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from diagnosis import document
from diagnosis.channels import Channel
from diagnosis.document import (
    Difference,
    GapCell,
    Number,
    Shrink,
    Verdict,
    load_verdict,
)
from diagnosis.report.words import joints_in_short
from diagnosis.terminal import twelve_lines
from spot_model.robot.facts import JOINT_NAMES

CELL = GapCell(signal="load", joint="fl_kn", regime="motoring", gap=2.0, floor=0.5, ratio=4.0, p_value=0.01)


def _verdict() -> Verdict:
    return Verdict(
        status="explained",
        where=(CELL,),
        differences=(
            Difference(
                name="coulomb_friction",
                probability=0.9,
                group=("coulomb_friction",),
                joints=("fl_kn",),
                split_by="",
                parameters={"level_nm": Number(value=2.0, low=1.8, high=2.2)},
            ),
        ),
        probability_none=0.01,
        probability_unknown=0.02,
        unknown=None,
        channels={Channel.SET_POINT_TO_LOAD: "used", Channel.BATTERY_POWER: "off: no battery record"},
        shrink=Shrink(d0=5.0, d1=1.5, floor=1.0, s=0.875, s_low=0.8, s_high=0.95, held_out=("a",)),
        log_advice=("Record more.",),
    )


def test_a_round_trip_changes_nothing(tmp_path) -> None:
    path = tmp_path / "verdict.json"
    path.write_text(_verdict().to_json())
    assert load_verdict(path) == _verdict()


def test_unknown_keys_and_impossible_probabilities_are_errors() -> None:
    data = json.loads(_verdict().to_json())
    with pytest.raises(ValidationError, match="surprise"):
        Verdict.model_validate(data | {"surprise": 1})
    with pytest.raises(ValidationError, match="probability_none"):
        Verdict.model_validate(data | {"probability_none": 1.5})


def test_the_schema_file_is_that_of_the_model() -> None:
    schema = json.dumps(Verdict.model_json_schema(by_alias=True), indent=1, sort_keys=True) + "\n"
    assert Path(document.__file__).with_name("verdict.schema.json").read_text() == schema


@pytest.mark.parametrize("n", [0, 1, 3, 5])
def test_the_terminal_says_it_in_about_twelve_lines(n: int) -> None:
    one = _verdict().differences[0]
    lines = twelve_lines(_verdict().model_copy(update={"differences": (one,) * n}), {})
    assert 9 <= len(lines) <= 13
    assert all(len(line.split()) > 1 and "\n" not in line for line in lines)
    told = "difference  dry friction at fl_kn, P 0.90; level 2 (1.8 to 2.2)" if n else "difference  none is shown"
    for said in (told, "logs        0; 1 of 2 channels can be used", "corrected   not measured", "Record more."):
        assert said in "\n".join(lines)


def test_joints_in_few_words() -> None:
    assert joints_in_short(JOINT_NAMES) == "all joints"
    assert joints_in_short(("fl_hy", "fr_hy", "hl_hy", "hr_hy", "fl_kn")) == "all forward hips (hy), fl_kn"
    assert joints_in_short(("hip",)) == "hip"
    assert joints_in_short(()) == ""
