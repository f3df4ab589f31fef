"""Sensors, estimator, contacts, supply and heat by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.facts import N_JOINTS
from spot_model.robot.rotation import rotate_wxyz
from withheld.realities.calibrating import limits
from withheld.realities.fault_kind import Ask, flags_of
from withheld.simulator.estimator import Estimator
from withheld.simulator.parameters import DriveParameters, SensingParameters, SupplyParameters
from withheld.simulator.power import Battery, Motors
from withheld.simulator.robot import Motion, Robot
from withheld.simulator.sensors import ContactDetector, InertialUnit, tilt_wxyz

STATE_S = 0.003
LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]])


def test_a_unit_at_rest_feels_gravity_and_a_crooked_one_feels_it_aslant() -> None:
    for tilt, expected in (
        ([0.0, 0.0, 0.0], [0.0, 0.0, 9.81]),
        ([0.1, 0.0, 0.0], [0.0, 9.81 * np.sin(0.1), 9.81 * np.cos(0.1)]),
    ):
        quiet = SensingParameters(imu_tilt_rpy_rad=np.array(tilt), gyro_noise_rad_s=0.0, acceleration_noise_m_s2=0.0)
        unit = InertialUnit(quiet, 3, 4, [np.random.default_rng(0)])
        for row in range(13):
            unit.note(row, LEVEL, np.zeros((1, 6)))
        _, felt = unit.sense(1)
        force, turn = unit.packets()
        assert felt[0] == pytest.approx(expected, abs=1e-9)
        assert force[2, 0] == pytest.approx(np.tile(expected, (3, 1)), abs=1e-9)
        assert np.all(turn == 0.0)


def test_packets_and_the_estimators_reading_agree_on_the_mean() -> None:
    unit = InertialUnit(SensingParameters(), 4, 4, [np.random.default_rng(0)])
    for row in range(17):
        velocity = np.zeros((1, 6))
        velocity[0, :3] = [0.3 * row, 0.0, 0.01 * row**2]
        unit.note(row, LEVEL, velocity)
    force, _ = unit.packets()
    _, felt = unit.sense(2)
    assert force[2, 0].mean(axis=0) == pytest.approx(felt[0], abs=1e-9)


def test_tilts_turn_about_the_units_own_axes() -> None:
    assert rotate_wxyz(tilt_wxyz(np.array([0.0, 0.2, 0.0])), np.array([0.0, 0.0, 1.0])) == pytest.approx(
        [np.sin(0.2), 0.0, np.cos(0.2)]
    )


def test_standing_feet_hold_the_estimate_still_against_a_biased_accelerometer() -> None:
    robot = Robot()
    estimator = Estimator(robot.estimator, LEVEL, np.zeros((1, 3)), STATE_S)
    still, joints = np.zeros((1, 3)), facts.DEFAULT_POSITION_RAD[np.newaxis]
    old, heavy = np.full((1, 4), 50.0), np.full((1, 4), 100.0)
    for _ in range(600):
        estimator.step(still, np.array([[0.05, 0.0, 9.81]]), joints, np.zeros((1, N_JOINTS)), old, heavy)
    assert np.linalg.norm(estimator.reported_velocity_m_s) < 0.01


def test_an_estimator_with_wrong_lengths_scales_the_legs_velocity() -> None:
    speeds = []
    for scale in (1.0, 0.9):
        robot = Robot()
        robot.estimator.odometry_scale = scale
        estimator = Estimator(robot.estimator, LEVEL, np.zeros((1, 3)), STATE_S)
        rates = np.tile([0.0, -0.5, 0.0], (1, 4))
        for _ in range(400):
            estimator.step(
                np.zeros((1, 3)),
                np.array([[0.0, 0.0, 9.81]]),
                facts.DEFAULT_POSITION_RAD[np.newaxis],
                rates,
                np.full((1, 4), 50.0),
                np.full((1, 4), 100.0),
            )
        speeds.append(float(estimator.reported_velocity_m_s[0, 0]))
    assert speeds[1] / speeds[0] == pytest.approx(0.9, abs=0.01)


def test_contacts_have_two_thresholds_and_wait() -> None:
    def flags(force: list[float], hold: float = 0.0) -> list[bool]:
        quick = SensingParameters(contact_filter_s=1e-9, contact_hold_states=np.full(4, hold))
        detector = ContactDetector(quick, 1, STATE_S)
        return [bool(detector.see(np.full((1, 4), f))[0, 0]) for f in force]

    assert flags([10.0, 18.0, 23.0, 18.0, 13.0, 18.0]) == [False, False, True, True, False, False]
    assert flags([0.0, 30.0, 30.0, 30.0, 30.0], hold=2.0) == [False, False, False, True, True]
    assert flags([0.0, 30.0, 0.0, 30.0, 30.0], hold=1.0) == [False, False, False, False, True]


def test_a_battery_sags_by_its_resistance_and_empties() -> None:
    battery = Battery(SupplyParameters(), 1)
    start = float(battery.bus_v[0])
    for _ in range(100):
        battery.step(np.full((1, N_JOINTS), 80.0), np.zeros((1, N_JOINTS)), STATE_S)
    power = 165.0 + 12 * 80.0
    assert float(battery.shown_v[0] * battery.shown_a[0]) == pytest.approx(power, rel=0.02)
    assert start - float(battery.bus_v[0]) == pytest.approx(0.035 * power / float(battery.bus_v[0]), rel=0.3)
    assert battery.charge_percent[0] < 85.0


def test_a_bus_limiter_brings_the_power_down_to_its_bound_and_spares_small_powers() -> None:
    robot = Robot()
    stated = limits.bus_limit(robot, Ask(np.random.default_rng(0), 1.0, flags_of(())))
    (part,) = robot.motors
    full = np.ones((1, N_JOINTS))
    for asked, speed in ((30.0, 5.0), (2.0, 2.0)):
        part.start(1)
        motion = Motion(7.5e-4, 0.0 * full, speed * full, 0.0 * full, 0.0 * full, 0.0 * full, full[:, :1])
        for _ in range(2000):
            given = part.act(asked * full, motion)
        drawn = float(np.sum(given * speed + 0.03 * given**2))
        if asked > 10.0:
            assert drawn == pytest.approx(stated["power_limit.power_w"], rel=0.03)
        else:
            assert np.all(given == asked)


def test_hot_motors_lose_torque_while_they_heat_and_cold_ones_do_not() -> None:
    robot = Robot()
    limits.hot_motors(robot, Ask(np.random.default_rng(0), 1.0, flags_of(("fl_hy",))))
    motors = Motors(robot.thermal, robot.drive, 1)
    shares = []
    for _ in range(3000):
        motors.heat(motors.copper_w(np.full((1, N_JOINTS), 20.0)), STATE_S)
        shares.append(motors.share[0].copy())
    assert shares[0][1] > 0.95
    assert shares[-1][1] < 0.85
    assert np.all(shares[-1][[0, 2, 4]] == 1.0)


def test_windings_keep_the_energy_that_they_get() -> None:
    robot = Robot()
    robot.thermal.winding_to_housing_k_per_w = np.full(N_JOINTS, 1e9)
    motors = Motors(robot.thermal, DriveParameters(), 1)
    for _ in range(100):
        motors.heat(np.full((1, N_JOINTS), 55.0), 0.01)
    # 55 W for a second into 55 J/K.
    assert motors.winding_c - robot.thermal.start_c == pytest.approx(1.0, abs=1e-6)
