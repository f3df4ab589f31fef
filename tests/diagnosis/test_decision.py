"""What is decided from distances and nats worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.decision_constants import (
    GAP_SLOPE,
    LARGEST_ERRORS,
    LEFT_SHARE,
    ODD_RUN,
    ORDINARY_LEFT_NM,
    PRESENCE_LOG_ODDS,
    RUNS_APART,
    UNKNOWN,
    USUAL_ERRORS,
)
from diagnosis.document import Consequences, GapChange
from diagnosis.verdict.assemble import status_of
from diagnosis.verdict.measured import Measurements
from diagnosis.verdict.probability import (
    Belief,
    beyond_formulas,
    is_none,
    is_there,
    is_unknown,
    ordinary_gap,
    shares,
)

ORDINARY_GAP = 2.3


def test_no_run_tells_more_than_its_odds_of_being_odd() -> None:
    most = (1.0 - ODD_RUN) / ODD_RUN
    first, second = shares([0.0, -1000.0], 1)
    assert first / second == pytest.approx(most)
    first, second = shares([-5000.0, 0.0], 5)
    assert second / first == pytest.approx(most**5)
    assert shares([7.0, 7.0, 7.0], 3) == pytest.approx([1.0 / 3.0] * 3)
    # Small evidence loses the share of odd runs, twice.
    first, second = shares([1e-6, 0.0], 1)
    assert np.log(first / second) == pytest.approx((1.0 - 2.0 * ODD_RUN) * 1e-6, rel=1e-4)


@pytest.mark.parametrize("n_rivals", [1, 5, 36])
def test_one_run_leaves_all_rivals_together_the_odds_of_an_odd_run(n_rivals: int) -> None:
    told = shares([0.0] + [-1000.0] * n_rivals, 1)
    assert told[0] == pytest.approx(1.0 - ODD_RUN)
    assert told[1:] == pytest.approx([ODD_RUN / n_rivals] * n_rivals)


def test_one_run_alone_proves_no_cause() -> None:
    assert is_there(1e5, 1) == pytest.approx(1.0 - ODD_RUN)
    assert is_there(1e5, 9) > 0.999


def test_evidence_counts_by_its_logarithm() -> None:
    offset, by_nats = PRESENCE_LOG_ODDS
    assert is_there(np.e, 9) == pytest.approx(1.0 / (1.0 + np.exp(-(offset + by_nats))))
    assert is_there(10.0, 9) < is_there(20.0, 9) < is_there(200.0, 9)
    assert is_there(0.0, 9) < 1e-6


def _believed(nats: dict[tuple[str, ...], float], best: tuple[str, ...]) -> Belief:
    """Of nine logs; what each effect adds is what the sets differ by."""
    by_set = {frozenset(effects): own for effects, own in nats.items()}
    gains = {n: by_set[frozenset(best)] - by_set.get(frozenset(best) - {n}, 0.0) for n in best}
    return Belief.of(nats, best, gains, 9)


def test_formulas_that_explain_nearly_as_much_are_one_group() -> None:
    def group(rival: float) -> dict[str, float]:
        return _believed({(): 0.0, ("torque_delay",): 300.0, ("torque_bandwidth",): rival}, ("torque_delay",)).group(
            "torque_delay"
        )

    # 46 nats of 300 are one nat: FORMULA_ERROR is 0.15. An odd one of the nine runs points to either of two others.
    runs = np.exp(np.array([0.0, -1.0, -300.0 / 46.0]) / 9.0)
    p = runs / runs.sum()
    delay, bandwidth, _ = ((1.0 - ODD_RUN) * p + ODD_RUN * (1.0 - p) / 2.0) ** 9
    assert group(300.0 - 46.0) == pytest.approx(
        {"torque_delay": delay / (delay + bandwidth), "torque_bandwidth": bandwidth / (delay + bandwidth)}
    )
    assert list(group(100.0)) == ["torque_delay"]


def test_what_an_effect_adds_to_the_others_decides() -> None:
    both = ("armature", "leg_mass")
    found = _believed({(): 0.0, both: 300.0, ("armature",): 298.0}, both)
    assert found.there["leg_mass"] == pytest.approx(is_there(2.0, 9))
    assert found.there["armature"] == pytest.approx(is_there(300.0, 9))


def test_a_robot_that_repeats_itself_well_keeps_more_floors_from_its_model() -> None:
    # 3-4-5: the model's error is four thirds of what even a right model keeps.
    scatter_nm = 0.75 * 0.3 * ORDINARY_LEFT_NM / RUNS_APART
    assert ordinary_gap(scatter_nm, 0.3) == pytest.approx(5.0 / 3.0 * RUNS_APART)
    assert ordinary_gap(100.0 * ORDINARY_LEFT_NM, 0.5) == pytest.approx(RUNS_APART, abs=1e-4)
    assert ordinary_gap(0.1, 0.3) > ordinary_gap(0.2, 0.3)
    assert ordinary_gap(0.2, 0.4) == pytest.approx(ordinary_gap(0.1, 0.2))


def test_errors_beyond_any_ordinary_ones_excuse_no_distance() -> None:
    assert ordinary_gap(0.2, 4.0 * LARGEST_ERRORS) == ordinary_gap(0.2, LARGEST_ERRORS)
    assert ordinary_gap(0.2, LARGEST_ERRORS) > ordinary_gap(0.2, 0.9 * LARGEST_ERRORS)


def test_errors_that_residuals_contradict_excuse_what_usual_ones_would() -> None:
    assert ordinary_gap(0.2, LARGEST_ERRORS, odd=1.0) == pytest.approx(ordinary_gap(0.2, USUAL_ERRORS))
    assert ordinary_gap(0.2, 0.5 * USUAL_ERRORS, odd=1.0) == ordinary_gap(0.2, 0.5 * USUAL_ERRORS)
    assert ordinary_gap(0.2, LARGEST_ERRORS) > ordinary_gap(0.2, LARGEST_ERRORS, odd=0.5) > ordinary_gap(0.2, 0.3)


def test_a_model_that_scatters_more_than_the_robot_lies_farther_from_it() -> None:
    # Seven floors of scatter and the robot's one: runs lie five floors apart.
    assert ordinary_gap(100.0 * ORDINARY_LEFT_NM, 0.5, 0.0, 7.0) == pytest.approx(5.0 * RUNS_APART, rel=1e-4)
    assert ordinary_gap(0.2, 0.3, 0.0, float("nan")) == ordinary_gap(0.2, 0.3)


def test_the_right_effects_may_leave_a_share_of_what_they_close() -> None:
    after = ORDINARY_GAP + 1.0
    assert is_unknown(after, 1.0 / LEFT_SHARE, 30.0, ORDINARY_GAP) == pytest.approx(
        is_unknown(ORDINARY_GAP, 0.0, 30.0, ORDINARY_GAP)
    )
    assert is_unknown(after, 10.0, 30.0, ORDINARY_GAP) < is_unknown(after, 0.0, 30.0, ORDINARY_GAP)


def test_rivals_that_explain_as_much_share_a_place() -> None:
    nats = {(): 0.0, ("coulomb_friction",): 30.0, ("stribeck_friction",): 29.0, ("armature",): 2.0}
    found = _believed(nats, ("coulomb_friction",))
    group = found.group("coulomb_friction")
    assert list(group) == ["coulomb_friction", "stribeck_friction"]
    assert group["stribeck_friction"] > 0.2
    # What is said of the place holds for the group as a whole.
    assert found.there["coulomb_friction"] == pytest.approx(is_there(30.0, 9))


def test_what_stays_of_gap_and_residuals_is_unknown() -> None:
    at, by_distance, by_nats = UNKNOWN
    far = np.log(1.2)
    by_residuals = 1.0 / (1.0 + np.exp(-(at + by_distance * far + by_nats * np.log(31.0))))
    by_gap = 1.0 / (1.0 + np.exp(-GAP_SLOPE * far))
    either = 1.0 - (1.0 - by_residuals) * (1.0 - by_gap)
    assert is_unknown(1.2 * ORDINARY_GAP, 0.0, 30.0, ORDINARY_GAP) == pytest.approx(either)
    assert is_unknown(2.0 * ORDINARY_GAP, 0.0, 0.0, ORDINARY_GAP) > 0.9
    assert is_unknown(0.5 * ORDINARY_GAP, 0.0, 0.0, ORDINARY_GAP) < 0.1
    assert is_unknown(0.3 * ORDINARY_GAP, 0.0, 50.0, ORDINARY_GAP) < 0.3


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
    ("terms", "unknown", "before", "share", "status"),
    [
        ((), 0.1, 1.1, None, "no_gap"),
        ((), 0.1, 1.3, 0.0, "calibration"),
        ((), 0.6, 1.1, 0.0, "unknown_effect"),
        ((object(),), 0.1, 1.1, None, "explained"),
        ((object(),), 0.1, 9.0, 0.6, "explained"),
        ((object(),), 0.1, 9.0, 0.4, "partly_explained"),
        ((object(),), 0.6, 9.0, 0.9, "partly_explained"),
    ],
)
def test_a_status_follows_from_what_is_left_of_the_gaps(
    terms: tuple[object, ...], unknown: float, before: float, share: float | None, status: str
) -> None:
    views = {Channel.SET_POINT_TO_LOAD: None}
    causes: Any = SimpleNamespace(
        found=SimpleNamespace(views=views, selection=SimpleNamespace(best=SimpleNamespace(terms=terms)))
    )
    measured = _measured(before, share)
    assert status_of(causes, measured, unknown, is_simulated=True) == status
    assert status_of(causes, measured, unknown, is_simulated=False) == status
    causes.found.views = {}
    assert status_of(causes, measured, unknown, is_simulated=False) == "cannot_tell"


def test_what_a_formula_like_it_may_leave_is_no_evidence_for_an_effect() -> None:
    gains, alike = np.array([200.0, 30.0, 30.0]), np.eye(3)
    assert beyond_formulas(gains, alike) == pytest.approx(gains)
    alike[0, 1] = 0.5
    # FORMULA_ERROR is 0.15: of 100 nats that the second could explain, 15 are the formula's own error.
    assert beyond_formulas(gains, alike) == pytest.approx([200.0, 30.0 / 16.0, 30.0])
    alike[1, 0] = 1.0
    assert beyond_formulas(gains, alike)[0] == pytest.approx(200.0)
