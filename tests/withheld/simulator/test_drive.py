"""Drives by numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from spot_model.robot.facts import N_JOINTS
from withheld.realities.calibrating import drive as drive_faults
from withheld.realities.calibrating import limits
from withheld.realities.fault_kind import Ask
from withheld.simulator.drives import PRESLIDING_RAD, Drives, LuGre
from withheld.simulator.parameters import DriveParameters
from withheld.simulator.robot import Motion, Robot

DT_S = 5e-4
EVERY = np.ones(N_JOINTS, dtype=np.bool_)


def ask(size: float = 1.0) -> Ask:
    return Ask(np.random.default_rng(0), size, EVERY)


def motion(speed: float = 0.0, gear: float = 0.0, angle: float = 0.0) -> Motion:
    full = np.full((1, N_JOINTS), 1.0)
    return Motion(DT_S, angle * full, speed * full, angle * full, speed * full, gear * full, np.full((1, 1), 55.0))


def held(robot: Robot, setpoint_rad: float, seconds: float = 0.4) -> Drives:
    """Drives against links that cannot move, set-point in front of the joints by so much."""
    start = np.tile([0.0, 1.0, -1.5], (1, 4))
    drives = Drives(robot, 1, start, DT_S)
    for step in range(round(seconds / DT_S)):
        drives.step(start + setpoint_rad, np.full(N_JOINTS, 60.0), np.full(N_JOINTS, 1.5))
        drives.follow(start, np.zeros_like(start))
        if step % 6 == 0:
            drives.refresh()
    return drives


def test_a_held_joint_bears_the_servo_laws_torque() -> None:
    drives = held(Robot(), 0.2)
    # 60 N·m/rad on 0.2 rad; nothing moves, so bristles are not bent.
    assert drives.motion.gear_nm == pytest.approx(12.0, abs=1e-6)


def test_a_rigid_gears_cell_feels_the_motor_less_what_the_rotor_takes() -> None:
    robot = Robot()
    robot.drive.coulomb_nm = np.zeros(N_JOINTS)
    start = np.tile([0.0, 1.0, -1.5], (1, 4))
    drives = Drives(robot, 1, start, DT_S)
    for step in range(1, 400):
        drives.step(start + 0.1, np.full(N_JOINTS, 60.0), np.full(N_JOINTS, 0.0))
        drives.follow(start, np.full_like(start, 50.0 * DT_S * step))
    # The link is accelerated by 50 rad/s²: 0.0403 and 0.0731 kg·m² take 2.02 and 3.66 N·m of the 6.
    assert drives.motion.gear_nm[0, [0, 2]] == pytest.approx([6.0 - 2.02, 6.0 - 3.66], abs=0.01)


def test_bristles_slip_at_the_coulomb_level_and_spring_before() -> None:
    parameters = DriveParameters(coulomb_nm=np.full(N_JOINTS, 1.5))
    sliding = LuGre(parameters, 1, DT_S)
    for _ in range(400):
        torque = sliding.torque_nm(np.full((1, N_JOINTS), 2.0))
    assert torque == pytest.approx(1.5, rel=1e-3)
    creeping = LuGre(parameters, 1, 1.0)
    bend = 0.1 * PRESLIDING_RAD
    torque = creeping.torque_nm(np.full((1, N_JOINTS), bend / 1.0))
    assert 0.0 < torque[0, 0] < 0.2 * 1.5


def test_stiction_is_over_the_coulomb_level_and_fades_with_speed() -> None:
    parameters = DriveParameters(
        coulomb_nm=np.full(N_JOINTS, 1.0), stiction_nm=np.full(N_JOINTS, 0.5), stribeck_rad_s=np.full(N_JOINTS, 0.3)
    )
    levels = []
    for speed in (0.03, 0.3, 3.0):
        friction_law = LuGre(parameters, 1, DT_S)
        for _ in range(4000):
            torque = friction_law.torque_nm(np.full((1, N_JOINTS), speed))
        levels.append(float(torque[0, 0]))
    assert levels == pytest.approx([1.5 - 0.5 * 0.01, 1.0 + 0.5 * np.exp(-1.0), 1.0], abs=0.01)


def test_a_gear_that_loses_takes_from_both_directions_of_power() -> None:
    robot = Robot()
    drive_faults.gear_loss(robot, ask())
    (part,) = robot.rotors
    zeros = np.zeros((1, N_JOINTS))
    driving = part.act(zeros, motion(speed=5.0, gear=10.0))[0, 0]
    driven = part.act(zeros, motion(speed=-5.0, gear=10.0))[0, 0]
    assert driving < -2.0
    assert driven > 1.5


def test_grease_thins() -> None:
    robot = Robot()
    drive_faults.viscous(robot, ask())
    (part,) = robot.rotors
    slow, quick = (-part.act(np.zeros((1, N_JOINTS)), motion(speed=v))[0, 0] for v in (1.0, 10.0))
    assert 5.0 * slow < quick < 10.0 * slow


def test_a_second_order_loop_lags_by_its_time() -> None:
    part = drive_faults.SecondOrder(np.full(N_JOINTS, 0.01), 0.9)
    part.start(1)
    steps = 200
    for step in range(steps):
        out = part.act(np.full((1, N_JOINTS), 100.0 * step * DT_S), motion())
    # A ramp of 100 N·m/s comes 10 ms late: 1 N·m short; a torque held over a step adds half a step.
    assert 100.0 * (steps - 1) * DT_S - out[0, 0] == pytest.approx(1.0, abs=0.08)


def test_a_soft_limit_is_never_passed_and_leaves_small_torques_alone() -> None:
    robot = Robot()
    limits.soft_limit(robot, ask())
    drives = held(robot, 2.0)
    assert np.abs(drives.motor_nm[0, 0]) < 14.001
    assert np.abs(drives.motor_nm[0, 0]) > 13.0
    assert held(robot, 0.1).motion.gear_nm[0, 0] == pytest.approx(held(Robot(), 0.1).motion.gear_nm[0, 0], abs=1e-6)


def test_play_leaves_the_link_without_torque_and_then_hits() -> None:
    robot = Robot()
    drive_faults.play(robot, ask())
    drives = held(robot, 0.0, 0.05)
    assert drives.motion.gear_nm[0, 0] == 0.0
    assert held(robot, 0.2).motion.gear_nm[0, 0] == pytest.approx(12.0 - 60.0 * 0.00525, abs=0.1)


def test_volts_bound_driving_and_leave_braking() -> None:
    robot = Robot()
    robot.drive.no_load_high_rad_s = np.full(N_JOINTS, 7.0)
    drives = Drives(robot, 1, np.tile([0.0, 1.0, -1.5], (1, 4)), DT_S)
    drives.motion.rotor_rad_s = np.full((1, N_JOINTS), 6.0)
    high, low = drives._bounds()
    assert high[0, 2] == pytest.approx(97.0 / (25.03 - 9.48) * 1.0, rel=0.02)
    assert low[0, 2] < -100.0


def test_a_soft_gear_twists_by_torque_over_stiffness() -> None:
    robot = Robot()
    robot.drive.is_elastic = EVERY
    robot.drive.gear_stiffness_nm_per_rad = np.full(N_JOINTS, 500.0)
    drives = held(robot, 0.2, 1.0)
    twist = drives.motion.rotor_rad - drives.motion.link_rad
    assert twist[0, 0] / drives.motion.gear_nm[0, 0] == pytest.approx(0.002, rel=1e-3)
