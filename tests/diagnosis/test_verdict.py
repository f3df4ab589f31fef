import json

import pytest
from pydantic import ValidationError

from diagnosis.channels.channel import Channel
from diagnosis.document import (
    SCHEMA_FILE,
    FoundEffect,
    GapCell,
    Number,
    Placebo,
    Shrink,
    Verdict,
    json_schema,
    load_verdict,
)
from diagnosis.terminal import joints_in_short, twelve_lines
from spot_model.robot.facts import JOINT_NAMES

CELL = GapCell(signal="load", joint="fl_kn", regime="motoring", gap=2.0, floor=0.5, ratio=4.0, p_value=0.01)
PLACEBO = Placebo(name="armature", s=0.2)


def _verdict() -> Verdict:
    return Verdict(
        status="explained",
        where=(CELL,),
        effects=(
            FoundEffect(
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
        shrink=Shrink(d0=5.0, d1=1.5, floor=1.0, s=0.875, s_low=0.8, s_high=0.95, held_out=("a",), placebo=PLACEBO),
        log_advice=("Record more.",),
    )


def test_a_round_trip_changes_nothing(tmp_path) -> None:
    path = tmp_path / "verdict.json"
    path.write_text(_verdict().to_json())
    assert load_verdict(path) == _verdict()


def test_the_keys_of_the_contract_are_there() -> None:
    data = json.loads(_verdict().to_json())
    assert data["schema"] == "spot-rl/verdict/1"
    words = "schema status where effects probability_none probability_unknown unknown channels shrink log_advice"
    wanted = set(words.split())
    assert wanted <= set(data)
    assert {"name", "probability", "group", "joints", "split_by", "parameters"} <= set(data["effects"][0])
    assert {"metric", "d0", "d1", "floor", "s", "s_low", "s_high", "held_out", "placebo"} <= set(data["shrink"])


def test_unknown_keys_and_impossible_probabilities_are_errors() -> None:
    data = json.loads(_verdict().to_json())
    with pytest.raises(ValidationError, match="surprise"):
        Verdict.model_validate(data | {"surprise": 1})
    with pytest.raises(ValidationError, match="probability_none"):
        Verdict.model_validate(data | {"probability_none": 1.5})


def test_the_schema_file_is_that_of_the_model() -> None:
    assert SCHEMA_FILE.read_text() == json_schema()


def test_the_terminal_says_it_in_twelve_lines() -> None:
    lines = twelve_lines(_verdict(), {})
    assert len(lines) == 12
    assert all(len(line.split()) > 1 for line in lines)
    one = _verdict().effects[0]
    for n in (0, 2, 3, 4):
        assert len(twelve_lines(_verdict().model_copy(update={"effects": (one,) * n}), {})) == 12
    text = "\n".join(lines)
    for word in (
        "explained",
        "fl_kn",
        "coulomb_friction, probability 0.90",
        "S 0.88",
        "placebo armature 0.20",
        "Record more.",
    ):
        assert word in text


def test_joints_in_few_words() -> None:
    assert joints_in_short(JOINT_NAMES) == "all joints"
    assert joints_in_short(("fl_hy", "fr_hy", "hl_hy", "hr_hy", "fl_kn")) == "all forward hips (hy), fl_kn"
    assert joints_in_short(("hip",)) == "hip"
    assert joints_in_short(()) == ""
