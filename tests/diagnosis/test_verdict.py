"""The keys of verdict.json are a contract with other programs: an example is read, and each of its keys is written."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest
from pydantic import ValidationError

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


def test_keys_and_types_change_on_purpose_alone() -> None:
    """What changes is told in CHANGELOG.md, under another ``schema`` if files no longer load; then here."""

    def bare(schema: Any) -> Any:
        if isinstance(schema, list):
            return [bare(part) for part in schema]
        if not isinstance(schema, dict):
            return schema
        return {key: bare(part) for key, part in schema.items() if key != "description" or isinstance(part, dict)}

    keys = json.dumps(bare(Verdict.model_json_schema()), sort_keys=True)
    assert hashlib.sha256(keys.encode()).hexdigest()[:16] == "4ac6a786fd544be7"


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


EXAMPLE = """
{"schema": "spot-rl/verdict/2", "status": "explained",
 "where": [{"signal": "load", "joint": "fl_kn", "regime": "motoring", "gap": 0.0, "floor": 0.0, "ratio": 0.0, "p_value": 0.0}],
 "headline": "", "warnings": [],
 "differences": [{"name": "coulomb_friction", "probability": 0.0, "group": ["coulomb_friction"], "joints": ["fl_kn"], "split_by": "…",
                  "parameters": {"level_nm": {"value": 0.0, "low": 0.0, "high": 0.0}}, "by_type": {}, "rivals": {},
                  "consequences": {"loop": "open", "changes": [],
                                   "gaps": [{"gap": "torque", "unit": "N·m", "before": 0.0, "after": 0.0, "floor": 0.0, "share": 0.0}]}}],
 "calibration": {"numbers": [{"effect": "torque_gain", "parameter": "gain", "title": "torque gain", "where": "kn", "nominal": 0.0,
                              "value": 0.0, "low": 0.0, "high": 0.0, "stands_out": false}], "consequences": null},
 "consequences": {"loop": "closed", "gaps": [], "changes": [{"quantity": "power", "title": "power", "unit": "W", "before": 0.0,
                                                             "after": 0.0, "robot": 0.0, "low": 0.0, "high": 0.0}]},
 "remainder": [{"gap": "body motion", "unit": "m/s", "left": 0.0, "floor": 0.0, "ratio": 0.0}],
 "probability_none": 0.0, "probability_unknown": 0.0,
 "unknown": {"joints": [], "regime": "", "channel": "base_wrench", "unit": "N·m", "left": 0.0, "usual": 0.0},
 "channels": {"set_point_to_load": "used", "battery_power": "off: no battery record"},
 "shrink": {"metric": "w1_mmd", "d0": 0.0, "d1": 0.0, "floor": 0.0, "s": 0.0, "s_low": 0.0, "s_high": 0.0, "held_out": []},
 "log_advice": []}
"""  # noqa: E501 - as a program reads it
OPTIONAL = ("schema", "headline", "warnings", "calibration", "consequences", "remainder")
"""Keys with a default."""
STATUSES = ("explained", "partly_explained", "unknown_effect", "calibration", "no_gap", "cannot_tell")


def _within(small: Any, large: Any, path: str = "") -> list[str]:
    """Where a key or a value of the example is not in what was written."""
    if isinstance(small, dict):
        lacking = [f"{path}.{k}" for k in small if k not in large]
        return lacking + [p for k in small if k in large for p in _within(small[k], large[k], f"{path}.{k}")]
    if isinstance(small, list):
        return [p for a, b in zip(small, large, strict=True) for p in _within(a, b, f"{path}[]")]
    return [] if small == large and type(small) is type(large) else [f"{path}: {small!r} became {large!r}"]


def test_the_example_is_read_and_written_with_every_key() -> None:
    example = json.loads(EXAMPLE)
    written = json.loads(Verdict.model_validate(example).to_json())
    assert _within(example, written) == []


@pytest.mark.parametrize("status", STATUSES)
def test_each_status_is_allowed(status: str) -> None:
    assert Verdict.model_validate(json.loads(EXAMPLE) | {"status": status}).status == status


def test_a_key_of_the_contract_that_is_missing_is_an_error() -> None:
    example = json.loads(EXAMPLE)
    for key in example:
        if key in OPTIONAL:
            continue
        with pytest.raises(ValueError, match=key):
            Verdict.model_validate({k: v for k, v in example.items() if k != key})


def test_another_schema_is_refused() -> None:
    with pytest.raises(ValueError, match="spot-rl/verdict/2"):
        Verdict.model_validate(json.loads(EXAMPLE) | {"schema": "spot-rl/verdict/1"})
