"""What is decided from distances and nats worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.decision_constants import GAP_SPREAD, MATTERS, ODD_RUN, ORDINARY_GAP
from diagnosis.verdict.assemble import finite
from diagnosis.verdict.posterior import Hypothesis, believe, capped

FAR = ORDINARY_GAP + 3.0


def test_no_run_tells_more_than_its_odds_of_being_odd() -> None:
    most = np.log((1.0 - ODD_RUN) / ODD_RUN)
    assert capped(1000.0, 1) == pytest.approx(most)
    assert capped(-1000.0, 5) == pytest.approx(-5.0 * most)
    assert capped(0.0, 3) == 0.0
    # Small evidence loses the share of odd runs, twice.
    assert capped(1e-6, 1) == pytest.approx((1.0 - 2.0 * ODD_RUN) * 1e-6, rel=1e-4)


def test_one_run_alone_proves_no_cause() -> None:
    hypotheses = (Hypothesis((), 0.0), Hypothesis(("torque_gain",), 300.0))
    assert believe(hypotheses, ("torque_gain",), 1, 0.0).effects["torque_gain"] == pytest.approx(1.0 - ODD_RUN)
    assert believe(hypotheses, ("torque_gain",), 9, 0.0).effects["torque_gain"] > 0.999


def test_a_robot_that_lies_where_ordinary_errors_lie_has_no_gap_whatever_residuals_show() -> None:
    hypotheses = (Hypothesis((), 0.0, ORDINARY_GAP - 0.5), Hypothesis(("command_jitter",), 60.0, ORDINARY_GAP - 0.6))
    found = believe(hypotheses, ("command_jitter",), 9, 0.0)
    assert found.effects["command_jitter"] < 0.5
    assert found.unknown == 0.0
    # So it is taken out of what is stated.
    assert believe(hypotheses, (), 9, 0.0).none > 0.95


def test_within_ordinary_distances_overwhelming_evidence_and_a_nearer_loop_name_an_effect() -> None:
    near = (Hypothesis((), 0.0, ORDINARY_GAP), Hypothesis(("coulomb_friction",), 120.0, ORDINARY_GAP - 2.0 * MATTERS))
    assert believe(near, ("coulomb_friction",), 9, 0.0).effects["coulomb_friction"] > 0.7
    faint = (near[0], Hypothesis(("coulomb_friction",), 4.0, ORDINARY_GAP - 0.5))
    assert believe(faint, ("coulomb_friction",), 9, 0.0).effects["coulomb_friction"] < 0.6
    still = (near[0], Hypothesis(("coulomb_friction",), 120.0, ORDINARY_GAP))
    assert believe(still, ("coulomb_friction",), 9, 0.0).effects["coulomb_friction"] < 0.3


def test_an_effect_that_closes_the_gap_is_its_cause() -> None:
    hypotheses = (Hypothesis((), 0.0, FAR), Hypothesis(("payload_mass",), 20.0, 1.2))
    found = believe(hypotheses, ("payload_mass",), 9, 0.0)
    assert found.effects["payload_mass"] > 0.95
    assert found.nearer["payload_mass"] == pytest.approx(FAR - 1.2)
    assert found.unknown == 0.0


def test_what_does_not_bring_closed_loops_nearer_is_no_cause_beside_one_that_does() -> None:
    both = ("payload_mass", "command_jitter")
    hypotheses = (
        Hypothesis((), 0.0, FAR),
        Hypothesis(both, 80.0, 1.2),
        Hypothesis(("payload_mass",), 20.0, 1.2 + 0.2 * MATTERS),
        Hypothesis(("command_jitter",), 60.0, FAR),
    )
    found = believe(hypotheses, both, 9, 0.0)
    assert found.effects["payload_mass"] > 0.9
    assert found.effects["command_jitter"] < 0.5


def test_a_gap_that_stays_is_unknown() -> None:
    hypotheses = (Hypothesis((), 0.0, FAR), Hypothesis(("torque_ripple",), 40.0, FAR - 0.3))
    found = believe(hypotheses, ("torque_ripple",), 9, 0.0)
    assert found.unknown > 0.9


def test_rivals_that_come_as_near_share_a_place() -> None:
    hypotheses = (
        Hypothesis((), 0.0, FAR),
        Hypothesis(("coulomb_friction",), 30.0, 1.2),
        Hypothesis(("stribeck_friction",), 29.0, 1.2),
        Hypothesis(("armature",), 29.0, 1.2 + 20.0 * GAP_SPREAD),
    )
    group = believe(hypotheses, ("coulomb_friction",), 9, 0.0).group(("coulomb_friction",), "coulomb_friction")
    assert list(group) == ["coulomb_friction", "stribeck_friction"]
    assert group["stribeck_friction"] > 0.2


@pytest.mark.parametrize(("nearer", "told"), [(1.5, 1.5), (-0.2, -0.2), (None, None), (float("inf"), None)])
def test_a_set_that_was_not_simulated_gives_no_distance(nearer: float | None, told: float | None) -> None:
    assert finite(nearer) == told


def test_without_the_smaller_set_nearer_is_infinite() -> None:
    both = ("armature", "coulomb_friction")
    found = believe((Hypothesis((), 0.0, FAR), Hypothesis(both, 60.0, 1.0)), both, 9, 0.0)
    assert found.nearer == dict.fromkeys(both, float("inf"))
