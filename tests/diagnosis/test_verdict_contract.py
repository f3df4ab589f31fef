"""The keys of verdict.json are a contract with other programs: an example is read, and each of its keys is written."""

import json
from typing import Any

import pytest

from diagnosis.document import Verdict

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
 "unknown": {"joints": [], "regime": "", "depends_on": []},
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
