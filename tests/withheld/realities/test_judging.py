"""Formulas of judging kinds by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from spot_model.robot.facts import N_JOINTS
from withheld.realities.fault_kind import Ask, Install, Parameters
from withheld.realities.judging import drive, limits, outside, signals
from withheld.simulator.robot import Motion, Robot, TorquePart

DT_S = 5e-4
EVERY = np.ones(N_JOINTS, dtype=np.bool_)
ZERO = np.zeros((1, N_JOINTS))


def ask(size: float = 1.0) -> Ask:
    return Ask(np.random.default_rng(0), size, EVERY)


def motion(speed: float = 0.0, angle: float = 0.0, gear: float = 0.0) -> Motion:
    one = np.ones((1, N_JOINTS))
    return Motion(DT_S, angle * one, speed * one, angle * one, speed * one, gear * one, np.full((1, 1), 55.0))


def only(install: Install, where: str, size: float = 1.0) -> tuple[TorquePart, Parameters]:
    """The one part that a fault adds, and what it states."""
    robot = Robot()
    stated = install(robot, ask(size))
    (part,) = getattr(robot, where)
    part.start(1)
    return part, stated


def test_maxwell_elements_slide_at_their_level_and_spring_before() -> None:
    part, _ = only(drive.dry, "rotors")
    # A tenth of a milliradian bends all three: 0.4/0.4 + 0.35/1.2 + 0.25/3 of 0.1 mrad/mrad, times 1.5 N·m.
    creeping = part.act(ZERO, motion(speed=1e-4 / DT_S))
    assert creeping == pytest.approx(-1.5 * 1e-4 * (0.4 / 4e-4 + 0.35 / 1.2e-3 + 0.25 / 3e-3))
    for _ in range(100):
        sliding = part.act(ZERO, motion(speed=2.0))
    assert sliding == pytest.approx(-1.5)


def test_a_lubricant_gives_its_stated_damping_at_a_walking_joints_speed() -> None:
    part, stated = only(drive.grease, "rotors")
    damping = stated["viscous_friction.damping_nm_s_per_rad"]
    assert part.act(ZERO, motion(speed=4.0)) == pytest.approx(-4.0 * damping)
    assert -part.act(ZERO, motion(speed=40.0))[0, 0] < 40.0 * damping


def test_teeth_rub_by_the_torque_that_they_pass_on() -> None:
    part, _ = only(drive.load, "rotors")
    for _ in range(100):
        out = part.act(ZERO, motion(speed=1.0, gear=-10.0))
    assert out == pytest.approx(-2.2)


def test_two_lags_are_as_late_as_stated() -> None:
    part, _ = only(drive.lag, "motors", 0.5)
    for step in range(400):
        out = part.act(np.full((1, N_JOINTS), 100.0 * step * DT_S), motion())
    # A ramp of 100 N·m/s comes 8 ms late: 0.8 N·m short; a torque held over a step adds up to a step.
    assert 100.0 * 399 * DT_S - out[0, 0] == pytest.approx(0.8, abs=0.1)


def test_coggings_fundamental_has_the_stated_size() -> None:
    part, stated = only(drive.cogging, "rotors")
    order = stated["torque_ripple.cycles_per_rad"]
    angles = np.linspace(0.0, 2.0 * np.pi / order, 400, endpoint=False)
    wave = np.array([part.act(ZERO, motion(angle=a))[0, 0] for a in angles])
    assert 2.0 * abs(np.mean(wave * np.exp(1j * order * angles))) == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(("asked_nm", "speed", "is_over"), [(30.0, 5.0, True), (2.0, 2.0, False)])
def test_a_budget_brings_the_power_down_and_spares_small_powers(asked_nm: float, speed: float, is_over: bool) -> None:
    part, stated = only(limits.budget, "motors")
    drawn = []
    for _ in range(2000):
        given = part.act(np.full((1, N_JOINTS), asked_nm), motion(speed=speed))
        drawn.append(float(np.sum(given * speed + limits.COPPER_W_PER_NM2 * given**2)))
    if is_over:
        assert np.mean(drawn[1000:]) == pytest.approx(stated["power_limit.power_w"], rel=0.1)
    else:
        assert np.all(given == asked_nm)


def test_waits_have_their_means_and_losses_their_share() -> None:
    n, rng = 40_000, np.random.default_rng(1)
    for install, word, reads in (
        (signals.late, "command_delay.delay_s", np.mean),
        (signals.uneven, "command_jitter.mean_s", np.mean),
        (signals.lost, "command_drop.probability", lambda x: np.mean(np.isinf(x))),
    ):
        robot = Robot()
        stated = install(robot, ask())
        assert reads(robot.delays[0](n, rng)) == pytest.approx(stated[word], rel=0.05)


def test_averaged_rates_lag_by_the_stated_time() -> None:
    part, stated = only(signals.average, "readings")
    for state in range(50):
        out = part.act(np.full((1, 36), 10.0 * 0.003 * state), 0.003)
    late_s = (10.0 * 0.003 * 49 - out[0, 12]) / 10.0
    assert late_s == pytest.approx(stated["velocity_filter.time_constant_s"])
    assert out[0, 0] == out[0, 24] == pytest.approx(10.0 * 0.003 * 49)


def test_a_bearing_rubs_at_its_angle_alone() -> None:
    part, _ = only(outside.bearing, "rotors")
    drag = np.array([part.act(ZERO, motion(speed=1.0, angle=a))[0, 0] for a in np.linspace(-1.0, 1.0, 201)])
    assert drag.min() == pytest.approx(-3.5, rel=0.01)
    assert np.mean(drag == 0.0) == pytest.approx(0.8, abs=0.02)


def test_drop_outs_take_their_share_of_the_time() -> None:
    part, _ = only(outside.drop_outs, "motors")
    out = np.array([part.act(np.ones((1, N_JOINTS)), motion())[0, 0] for _ in range(60_000)])
    # 2.5 a second of 75 ms each, counted from the end of the one before.
    assert np.mean(out == 0.0) == pytest.approx(0.075 / (0.075 + 0.4), abs=0.06)


def test_a_wandering_torque_has_its_size() -> None:
    part, _ = only(outside.wandering, "motors")
    out = np.array([part.act(ZERO, motion())[0] for _ in range(40_000)])
    assert np.sqrt(np.mean(out**2)) == pytest.approx(3.0, rel=0.2)
