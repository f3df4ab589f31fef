"""What is decided from distances and nats worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.decision_constants import (
    GAP_SPREAD,
    LARGEST_ERRORS,
    LEAST_MOVED,
    LEFT_SHARE,
    MOVED,
    ODD_RUN,
    ORDINARY_LEFT_NM,
    RUNS_APART,
    THERE,
    UNKNOWN,
    USUAL_ERRORS,
)
from diagnosis.verdict.assemble import finite, status_of
from diagnosis.verdict.posterior import (
    Belief,
    Hypothesis,
    believe,
    closed_by,
    is_gap,
    is_there,
    is_unknown,
    matters,
    ordinary_gap,
    shares,
)

ORDINARY_GAP = 2.3
FAR = ORDINARY_GAP + 3.0


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
    assert is_there(1e5, None, 1) == pytest.approx(1.0 - ODD_RUN)
    assert is_there(1e5, 3.0, 1) == pytest.approx(1.0 - ODD_RUN)
    assert is_there(1e5, None, 9) > 0.999
    # A set that was not simulated says nothing of where closed loops lie.
    assert is_there(20.0, float("inf"), 9) == is_there(20.0, None, 9)


def test_evidence_counts_by_its_logarithm_and_closed_loops_for_or_against() -> None:
    offset, by_nats, by_floors = THERE
    assert is_there(np.e, 0.5, 9) == pytest.approx(1.0 / (1.0 + np.exp(-(offset + by_nats + 0.5 * by_floors))))
    assert is_there(20.0, -1.0, 9) < is_there(20.0, 0.0, 9) < is_there(20.0, 1.0, 9)
    assert is_there(0.0, 0.0, 9) < 1e-6


def test_an_effect_matters_by_what_it_moves() -> None:
    offset, slope, _ = MOVED
    assert matters(np.exp((np.log1p(LEAST_MOVED) - offset) / slope) - 1.0) == pytest.approx(0.5)
    assert matters(4.0) > 0.99
    assert matters(0.0) < 0.2
    assert matters(-0.3) < matters(0.0)
    # Without it the model falls at once: nothing matters more.
    assert matters(float("nan")) == 1.0


def _believed(
    hypotheses: tuple[Hypothesis, ...], best: tuple[str, ...], beyond_nats: float = 0.0, **moved: float
) -> Belief:
    """Of nine logs; what each effect adds is what the hypotheses differ by."""
    nats = {frozenset(h.effects): h.nats for h in hypotheses}
    gains = {n: nats[frozenset(best)] - nats.get(frozenset(best) - {n}, 0.0) for n in best}
    return believe(hypotheses, best, gains, 9, beyond_nats, moved, ORDINARY_GAP)


def test_what_is_beyond_doubt_and_moves_nothing_is_there_and_no_cause() -> None:
    hypotheses = (Hypothesis((), 0.0, ORDINARY_GAP - 1.0), Hypothesis(("command_jitter",), 200.0, ORDINARY_GAP - 1.1))
    found = _believed(hypotheses, ("command_jitter",), command_jitter=-0.1)
    assert found.there["command_jitter"] > 0.95
    assert found.effects["command_jitter"] < 0.15
    assert found.unknown < 0.05
    assert found.none > 0.8


def test_formulas_that_explain_nearly_as_much_are_one_group() -> None:
    def group(rival: float) -> dict[str, float]:
        hypotheses = (
            Hypothesis((), 0.0, FAR),
            Hypothesis(("torque_delay",), 300.0, 1.2),
            Hypothesis(("torque_bandwidth",), rival, 1.2),
        )
        return _believed(hypotheses, ("torque_delay",), torque_delay=4.0).group("torque_delay")

    # 46 nats of 300 are one nat: FORMULA_ERROR is 0.15. An odd one of the nine runs points to either of two others.
    runs = np.exp(np.array([0.0, -1.0, -300.0 / 46.0 - (FAR - 1.2) / GAP_SPREAD]) / 9.0)
    p = runs / runs.sum()
    delay, bandwidth, _ = ((1.0 - ODD_RUN) * p + ODD_RUN * (1.0 - p) / 2.0) ** 9
    assert group(300.0 - 46.0) == pytest.approx(
        {"torque_delay": delay / (delay + bandwidth), "torque_bandwidth": bandwidth / (delay + bandwidth)}
    )
    assert list(group(100.0)) == ["torque_delay"]


def test_a_single_effect_is_judged_once() -> None:
    hypotheses = (Hypothesis((), 0.0, 2.4), Hypothesis(("command_delay",), 10.0, 1.8))
    found = _believed(hypotheses, ("command_delay",), command_delay=1.5)
    assert found.there["command_delay"] == pytest.approx(is_there(10.0, 0.6, 9))


def test_an_effect_that_closes_the_gap_is_its_cause() -> None:
    hypotheses = (Hypothesis((), 0.0, FAR), Hypothesis(("payload_mass",), 20.0, 1.2))
    found = _believed(hypotheses, ("payload_mass",), payload_mass=4.0)
    assert found.effects["payload_mass"] > 0.95
    assert found.nearer["payload_mass"] == pytest.approx(FAR - 1.2)
    assert found.unknown < 0.05
    assert found.none < 0.01


def test_what_alone_closes_a_gap_is_its_cause_however_little_the_model_moves() -> None:
    far, near = 2.0 * ORDINARY_GAP, 0.5 * ORDINARY_GAP

    def found(left: float, beyond_nats: float = 0.0) -> Belief:
        sets = (Hypothesis((), 0.0, far), Hypothesis(("torque_bandwidth",), 200.0, left))
        return _believed(sets, ("torque_bandwidth",), beyond_nats, torque_bandwidth=0.2)

    assert found(near).effects["torque_bandwidth"] > 0.9
    # Half of the gap is left, or signals still predict much: the rest of it has another cause.
    half = found(ORDINARY_GAP + 0.5 * (far - ORDINARY_GAP))
    assert half.effects["torque_bandwidth"] < found(near, 1000.0).effects["torque_bandwidth"] + 0.2 < 0.95


def test_effects_share_the_gap_that_they_close_by_how_much_nearer_each_comes() -> None:
    # 4 floors apart, 2 of them ordinary; the set closes 1.5 of the gap of 2.
    shares_of = closed_by(4.0, 1.5, {"leg_mass": 0.9, "imu_tilt": 0.3, "backlash": -0.2}, 2.0)
    assert shares_of == pytest.approx({"leg_mass": 0.75 * 0.75, "imu_tilt": 0.75 * 0.25, "backlash": 0.0})
    assert closed_by(1.9, 1.5, {"leg_mass": 1.5}, 2.0) == {"leg_mass": 0.0}
    assert closed_by(4.0, 3.0, {"leg_mass": float("inf")}, 2.0) == {"leg_mass": 1.0}
    assert closed_by(4.0, 0.0, {"leg_mass": 0.3}, 2.0) == {"leg_mass": 0.0}


def test_an_effect_that_is_only_alike_is_not_there() -> None:
    sets = (Hypothesis((), 0.0, 4.0 * ORDINARY_GAP), Hypothesis(("torque_gain",), 200.0, 2.0 * ORDINARY_GAP))

    def found(alike: float) -> Belief:
        gains = {"torque_gain": 200.0}
        return believe(
            sets, ("torque_gain",), gains, 9, 0.0, {"torque_gain": 4.0}, ORDINARY_GAP, {"torque_gain": alike}
        )

    assert found(0.0).effects["torque_gain"] > 0.95
    assert found(0.6).effects["torque_gain"] == pytest.approx(0.4 * found(0.0).effects["torque_gain"])


def test_an_effect_with_which_closed_loops_lie_farther_off_needs_so_much_more_evidence() -> None:
    doubtful, clear = (
        _believed(
            (Hypothesis((), 0.0, ORDINARY_GAP), Hypothesis(("leg_mass",), nats, ORDINARY_GAP + 1.0)),
            ("leg_mass",),
            leg_mass=4.0,
        )
        for nats in (10.0, 1000.0)
    )
    assert doubtful.effects["leg_mass"] < 0.1
    assert clear.effects["leg_mass"] > 0.9


def test_each_effect_is_judged_by_what_it_moves_itself() -> None:
    both = ("payload_mass", "command_jitter")
    hypotheses = (
        Hypothesis((), 0.0, FAR),
        Hypothesis(both, 80.0, 1.2),
        Hypothesis(("payload_mass",), 20.0, 1.25),
        Hypothesis(("command_jitter",), 60.0, FAR),
    )
    found = _believed(hypotheses, both, payload_mass=4.0, command_jitter=-0.1)
    assert found.effects["payload_mass"] > 0.9
    assert found.effects["command_jitter"] < 0.2


def test_effects_that_make_up_for_each_other_and_lead_away_from_the_robot_are_not_there() -> None:
    both = ("leg_mass", "torque_gain")
    hypotheses = (
        Hypothesis((), 0.0, ORDINARY_GAP),
        Hypothesis(both, 100.0, ORDINARY_GAP + 3.0),
        Hypothesis(("leg_mass",), 60.0, ORDINARY_GAP + 8.0),
        Hypothesis(("torque_gain",), 60.0, ORDINARY_GAP + 8.0),
    )
    assert max(_believed(hypotheses, both, leg_mass=4.0, torque_gain=4.0).effects.values()) < 0.05


def test_what_stays_of_gap_and_residuals_is_unknown() -> None:
    at, by_distance, by_nats = UNKNOWN
    log_odds = at + by_distance * np.log(2.0) + by_nats * np.log(101.0)
    assert is_unknown(2.0 * ORDINARY_GAP, 0.0, 100.0, ORDINARY_GAP) == pytest.approx(1.0 / (1.0 + np.exp(-log_odds)))
    assert is_unknown(2.0 * ORDINARY_GAP, 0.0, 300.0, ORDINARY_GAP) > 0.9
    # A gap that residuals know nothing of, and residuals that make no gap, are doubtful.
    assert is_unknown(ORDINARY_GAP, 0.0, 0.0, ORDINARY_GAP) < 0.1
    assert is_unknown(0.3 * ORDINARY_GAP, 0.0, 50.0, ORDINARY_GAP) < 0.3


def test_what_robots_without_a_fault_keep_is_no_gap() -> None:
    assert is_gap(ORDINARY_GAP, ORDINARY_GAP) == 0.5
    assert is_gap(0.5 * ORDINARY_GAP, ORDINARY_GAP) < 0.02
    assert is_gap(2.0 * ORDINARY_GAP, ORDINARY_GAP) > 0.98


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


@pytest.mark.parametrize("distance", [None, 0.5])
def test_one_run_does_not_prove_that_nothing_is_wrong(distance: float | None) -> None:
    def none(n_runs: int) -> float:
        return believe((Hypothesis((), 0.0, distance),), (), {}, n_runs, 0.0, {}, ORDINARY_GAP).none

    assert none(1) == pytest.approx(1.0 - ODD_RUN)
    assert none(3) > 0.99


@pytest.mark.parametrize("distance", [0.5, 1.0, 1.2, 3.0])
def test_a_gap_that_no_effect_makes_is_unknown_and_what_makes_none_does_not_matter(distance: float) -> None:
    found = believe((Hypothesis((), 0.0, distance * ORDINARY_GAP),), (), {}, 9, 1e4, {}, ORDINARY_GAP)
    assert found.none == pytest.approx(1.0 - is_gap(distance * ORDINARY_GAP, ORDINARY_GAP))
    assert found.unknown == pytest.approx(1.0 - found.none)


def test_no_gap_a_known_cause_and_an_unknown_one_alone_add_up_to_one() -> None:
    both = ("payload_mass", "leg_mass")
    sets = (
        Hypothesis((), 0.0, 1.3 * ORDINARY_GAP),
        Hypothesis(both, 12.0, ORDINARY_GAP),
        Hypothesis(("payload_mass",), 8.0, 1.1 * ORDINARY_GAP),
        Hypothesis(("leg_mass",), 8.0, 1.2 * ORDINARY_GAP),
    )
    found = _believed(sets, both, 5.0, payload_mass=1.0, leg_mass=0.5)
    known = 1.0 - np.prod([1.0 - p for p in found.effects.values()])
    assert 0.05 < known < 0.95
    beside = is_unknown(ORDINARY_GAP, 0.3 * ORDINARY_GAP, 5.0, ORDINARY_GAP)
    alone = found.unknown - known * beside
    assert alone == pytest.approx(is_gap(1.3 * ORDINARY_GAP, ORDINARY_GAP) * (1.0 - known))
    assert found.none + known + alone == pytest.approx(1.0)


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


def test_rivals_that_come_as_near_share_a_place() -> None:
    hypotheses = (
        Hypothesis((), 0.0, FAR),
        Hypothesis(("coulomb_friction",), 30.0, 1.2),
        Hypothesis(("stribeck_friction",), 29.0, 1.2),
        Hypothesis(("armature",), 29.0, 1.2 + 20.0 * GAP_SPREAD),
    )
    found = _believed(hypotheses, ("coulomb_friction",), coulomb_friction=3.0)
    group = found.group("coulomb_friction")
    assert list(group) == ["coulomb_friction", "stribeck_friction"]
    assert group["stribeck_friction"] > 0.2
    # What is said of the place holds for the group as a whole.
    assert found.there["coulomb_friction"] == pytest.approx(is_there(30.0, FAR - 1.2, 9))


@pytest.mark.parametrize(("nearer", "told"), [(1.5, 1.5), (-0.2, -0.2), (None, None), (float("inf"), None)])
def test_a_set_that_was_not_simulated_gives_no_distance(nearer: float | None, told: float | None) -> None:
    assert finite(nearer) == told


def test_without_the_smaller_set_nearer_is_infinite() -> None:
    both = ("armature", "coulomb_friction")
    found = _believed((Hypothesis((), 0.0, FAR), Hypothesis(both, 60.0, 1.0)), both, **dict.fromkeys(both, 2.0))
    assert found.nearer == dict.fromkeys(both, float("inf"))


@pytest.mark.parametrize(
    ("none", "unknown", "status"),
    [(0.9, 0.05, "no_gap"), (0.5, 0.5, "no_gap"), (0.24, 0.34, "unknown_effect"), (0.1, 0.8, "unknown_effect")],
)
def test_a_gap_that_no_cause_explains_is_unknown_however_doubtful_each_cause_is(
    none: float, unknown: float, status: str
) -> None:
    causes: Any = SimpleNamespace(
        found=SimpleNamespace(views={}, selection=SimpleNamespace(best=None)),
        belief=Belief((), none, unknown, {}, {}),
        distances={"nominal": 2.0},
        left=2.0,
    )
    assert status_of(causes) == status
