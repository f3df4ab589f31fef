"""Ordinary errors and surroundings: everywhere, in their sizes, and the same whatever else is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from withheld.plan import FaultRequest
from withheld.realities.reality import make
from withheld.realities.source import CATALOGUES
from withheld.simulator.body import build_model
from withheld.simulator.draws import SCALES, add_ordinary_errors, draw_scale
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Robot


def test_scales_are_log_uniform_between_a_half_and_five() -> None:
    rng = np.random.default_rng(0)
    scales = np.array([draw_scale(rng) for _ in range(4000)])
    assert SCALES[0] <= scales.min()
    assert scales.max() <= SCALES[1]
    # Half of the logarithm lies below the geometric mean of the bounds.
    assert np.mean(scales < np.sqrt(0.5 * 5.0)) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("scale", [0.5, 5.0])
def test_errors_grow_with_the_scale(scale: float) -> None:
    gains, masses = [], []
    plain = build_model(Robot(), Settings())
    for seed in range(20):
        robot = Robot()
        add_ordinary_errors(robot, np.random.default_rng(seed), scale)
        gains.append(np.log(robot.drive.torque_constant))
        masses.append(np.log(build_model(robot, Settings()).body_mass[2:] / plain.body_mass[2:]))
    assert np.std(gains) == pytest.approx(0.008 * scale, rel=0.15)
    assert np.std(masses) == pytest.approx(0.012 * scale, rel=0.15)


def test_leaving_a_fault_out_leaves_the_same_robot() -> None:
    one, two = (FaultRequest(kind=k, place="body", size=0.5) for k in ("saddlebags", "askew_unit"))
    both, single, none = (make(r, 4, CATALOGUES["judging"]) for r in ((one, two), (two,), ()))
    assert both.truth.faults[1] == single.truth.faults[0]
    assert both.truth.error_scale == none.truth.error_scale
    assert both.settings == none.settings
    for name in ("kp_scale", "coulomb_nm"):
        assert np.array_equal(getattr(both.robot().drive, name), getattr(none.robot().drive, name))
    assert both.robot().link == none.robot().link


def test_robots_differ_in_load_cells_ground_estimator_and_link() -> None:
    robots = [make((), seed, {}).robot() for seed in range(40)]
    lags = [r.sensing.load_filter_s for r in robots]
    assert min(lags) < 1e-3
    assert 5e-3 < max(lags) <= 6e-3
    assert {r.link.schedule for r in robots} == {"timer", "divider"}
    for values in ([r.foot_friction[0] for r in robots], [r.estimator.odometry_time_s for r in robots]):
        assert np.ptp(values) > 0.02
