"""What is decided from nats worked out by hand."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.decision_constants import ODD_RUN
from diagnosis.document import Consequences, GapChange
from diagnosis.verdict.assemble import verdict_status
from diagnosis.verdict.belief import (
    CALIBRATED,
    LEAST,
    beyond_formulas,
    group_of,
    is_none,
    most_log_odds,
    weighted_sets,
)
from diagnosis.verdict.measured import Measurements


def test_no_run_tells_more_than_its_odds_of_being_odd() -> None:
    assert most_log_odds(1) == pytest.approx(np.log((1.0 - ODD_RUN) / ODD_RUN))
    assert most_log_odds(5) == pytest.approx(5.0 * most_log_odds(1))


def _set(value: float, *names: str) -> Any:
    terms = tuple(SimpleNamespace(effect=SimpleNamespace(name=name)) for name in names)
    return SimpleNamespace(terms=terms, value=value)


def _found(gain: float, own: str, rivals: Mapping[str, float]) -> Any:
    """One effect that adds some nats, and others alone in its place."""
    best = _set(gain, own)
    every = (best, *(_set(value, name) for name, value in rivals.items()))
    selection = SimpleNamespace(best=best, gains={own: gain}, rivals={own: every})
    return SimpleNamespace(selection=selection, effects=(own,), board=SimpleNamespace(kept={"null": _set(0.0)}))


def test_formulas_that_explain_nearly_as_much_are_one_group() -> None:
    # 46 nats of 300 are one nat: FORMULA_ERROR is 0.15.
    rivals = {"torque_bandwidth": 300.0 - 46.0, "load_filter": 305.0, "armature": 100.0}
    shares = np.array([1.0, 1.0, np.exp(-1.0)])
    group = group_of(_found(300.0, "torque_delay", rivals), "torque_delay")
    # The effect itself comes first, though another explains a little more; one that explains a third is no rival.
    assert list(group) == ["torque_delay", "load_filter", "torque_bandwidth"]
    assert list(group.values()) == pytest.approx(list(shares / shares.sum()))
    assert group_of(_found(300.0, "torque_delay", {}), "torque_delay") == {"torque_delay": 1.0}


def test_a_set_is_as_likely_as_its_effect_is_there_and_named_right() -> None:
    """Drag, or a gain in its place with half its weight, 0.9; a delay is no rival."""
    found = _found(30.0, "drag", {"gain": 29.0, "delay": 1.0})
    sets = weighted_sets(found, {"drag": 0.9}, {"drag": {"drag": 2.0 / 3.0, "gain": 1.0 / 3.0}})
    assert {name: weight for name, (_, weight) in sets.items()} == pytest.approx(
        {"drag": 0.6, "gain": 0.3, CALIBRATED: 0.1}
    )
    sure = weighted_sets(found, {"drag": 1.0}, {"drag": {"drag": 1.0}})
    assert sure[CALIBRATED][1] == pytest.approx(LEAST / (1.0 + LEAST))


def test_one_run_does_not_prove_that_nothing_is_wrong() -> None:
    assert is_none((), 0.01, 1) == pytest.approx(1.0 - ODD_RUN)
    assert is_none((), 0.01, 3) > 0.95
    assert is_none((0.5, 0.5), 0.2, 9) == pytest.approx(0.25 * 0.8)


def _measured(before: float, share: float | None) -> Measurements:
    left = 1.0 + (before - 1.0) * (1.0 - (share or 0.0))
    gaps = tuple(
        GapChange(gap=gap, unit="", before=before, after=left, floor=1.0, share=share)
        for gap in ("torque", "joint motion", "body motion")
    )
    whole = Consequences(loop="closed", gaps=gaps)
    return Measurements(whole, whole, {}, ())


@pytest.mark.parametrize(
    ("there", "unknown", "before", "share", "status"),
    [
        ({}, 0.1, 1.1, None, "no_gap"),
        ({}, 0.1, 1.3, 0.0, "calibration"),
        ({}, 0.6, 1.1, 0.0, "unknown_effect"),
        ({"armature": 0.9}, 0.1, 1.1, None, "explained"),
        ({"armature": 0.9}, 0.1, 9.0, 0.6, "explained"),
        ({"armature": 0.9, "torque_gain": 0.5}, 0.1, 9.0, 0.4, "partly_explained"),
        ({"armature": 0.9}, 0.6, 9.0, 0.9, "partly_explained"),
        ({"armature": 0.5, "torque_gain": 0.5}, 0.1, 9.0, 0.9, "cannot_tell"),
    ],
)
def test_a_status_follows_from_what_is_left_of_the_gaps(
    there: dict[str, float], unknown: float, before: float, share: float | None, status: str
) -> None:
    views = {Channel.SET_POINT_TO_LOAD: None}
    belief: Any = SimpleNamespace(found=SimpleNamespace(views=views, effects=tuple(there)), there=there)
    measured = _measured(before, share)
    assert verdict_status(belief, measured, unknown, is_simulated=True) == status
    assert verdict_status(belief, measured, unknown, is_simulated=False) == status
    belief.found.views = {}
    assert verdict_status(belief, measured, unknown, is_simulated=False) == "cannot_tell"


def test_what_a_formula_like_it_may_leave_is_no_evidence_for_an_effect() -> None:
    gains, alike = np.array([200.0, 30.0, 30.0]), np.eye(3)
    assert beyond_formulas(gains, alike) == pytest.approx(gains)
    alike[0, 1] = 0.5
    # FORMULA_ERROR is 0.15: of 100 nats that the second could explain, 15 are the formula's own error.
    assert beyond_formulas(gains, alike) == pytest.approx([200.0, 30.0 / 16.0, 30.0])
    alike[1, 0] = 1.0
    assert beyond_formulas(gains, alike)[0] == pytest.approx(200.0)
