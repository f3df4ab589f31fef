"""The robot as a whole: power, stand, sit, falls, e-stop, time."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from fake_robot.network.requests import StandPose
from fake_robot.network.status import EstopLevel, Mode, MotorPower
from fake_robot.robot.modes import MotionRefusedError
from fake_robot.robot.motion.vendor_motion import leg_angles_rad, sit_path, stand_feet_m, stand_path
from fake_robot.robot.robot import Robot, TimeModeError
from fake_robot.scenario.scenario import Scenario
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m

NS = 1_000_000_000


def test_it_starts_on_the_ground_at_rest_without_power(make):
    driver = make()
    driver.run(0.3)
    snapshot, truth = driver.robot.snapshot(), driver.robot.truth()
    assert (snapshot.mode, snapshot.motor_power) == (Mode.LIMP, MotorPower.OFF)
    assert truth.body_height_m == pytest.approx(0.085, abs=0.003)
    assert np.abs(truth.joint_velocity_rad_s).max() < 0.05
    assert not truth.has_fallen


def test_power_on_takes_robot_time(make):
    driver = make(power={"power_on_s": 1.0})
    driver.robot.power_on()
    driver.run(0.99)
    assert driver.robot.snapshot().motor_power is MotorPower.POWERING_ON
    driver.run(0.02)
    assert (driver.robot.snapshot().motor_power, driver.robot.snapshot().mode) == (MotorPower.ON, Mode.SITTING)


def test_it_stands_at_the_height_of_its_scenario(make):
    driver = make()
    driver.stand_up()
    truth = driver.robot.truth()
    assert driver.robot.snapshot().mode is Mode.STANDING
    assert truth.body_height_m == pytest.approx(0.52, abs=0.01)
    assert truth.foot_contact.all()
    assert truth.foot_force_n.sum() == pytest.approx(facts.TOTAL_MASS_KG * 9.81, rel=0.02)
    assert np.hypot(*truth.position_of_body_in_world_m[:2]) < 0.2


def test_it_stands_higher_and_tilted_when_asked(standing):
    driver = standing()
    driver.robot.stand([StandPose(height_m=-0.08, pitch_rad=0.1)])
    driver.run(1.5)
    truth = driver.robot.truth()
    assert driver.robot.snapshot().mode is Mode.STANDING
    assert truth.body_height_m == pytest.approx(0.44, abs=0.015)
    w, x, y, z = truth.world_from_body_wxyz
    assert np.arcsin(2 * (w * y - z * x)) == pytest.approx(0.1, abs=0.03)


def test_it_sits_down_gently_and_powers_off(standing):
    driver = standing()
    driver.robot.safe_power_off()
    seen = []
    heights = []
    while driver.robot.snapshot().motor_power is not MotorPower.OFF:
        driver.run(0.03)
        seen.append((driver.robot.snapshot().mode, driver.robot.snapshot().motor_power))
        heights.append(driver.robot.truth().body_height_m)
        assert len(seen) < 200
    assert seen[0] == (Mode.SITTING_DOWN, MotorPower.ON)
    assert (Mode.LIMP, MotorPower.POWERING_OFF) in seen
    assert np.diff(heights).min() > -0.025
    assert heights[-1] < 0.12


def test_what_it_cannot_do_is_refused_with_the_reason(make):
    driver = make()
    with pytest.raises(MotionRefusedError, match="stand: the motors are off; power them on first"):
        driver.robot.stand()
    driver.robot.set_estop_level(EstopLevel.CUT)
    with pytest.raises(MotionRefusedError, match="the e-stop level is cut; release it before power on"):
        driver.robot.power_on()
    driver.robot.set_estop_level(EstopLevel.NONE)
    driver.stand_up()
    driver.robot.inject("behavior_fault", {"cause": "hardware"}, None)
    with pytest.raises(MotionRefusedError, match=r"joint control: behaviour faults are active: hardware \(1\)"):
        driver.robot.enter_joint_control()
    assert not driver.robot.clear_behavior_fault(9)
    assert driver.robot.clear_behavior_fault(1)
    driver.robot.stand()


def test_an_estop_cut_drops_the_robot_softly(standing):
    driver = standing()
    driver.robot.set_estop_level(EstopLevel.CUT)
    assert driver.robot.snapshot().mode is Mode.LIMP
    fastest = 0.0
    for _ in range(60):
        driver.run(0.03)
        fastest = max(fastest, -driver.robot.truth().linear_vel_of_body_in_world_m_s[2])
    assert driver.robot.snapshot().motor_power is MotorPower.OFF
    assert driver.robot.truth().body_height_m < 0.2
    # In free fall over 0.4 m it would reach 2.8 m/s.
    assert 0.1 < fastest < 1.5


def test_an_estop_that_settles_sits_first_and_then_cuts(standing):
    driver = standing()
    driver.robot.set_estop_level(EstopLevel.SETTLE_THEN_CUT)
    assert driver.robot.snapshot().mode is Mode.SITTING_DOWN
    driver.run(1.0)
    assert driver.robot.snapshot().motor_power is MotorPower.ON
    driver.run(2.0)
    assert driver.robot.snapshot().motor_power is MotorPower.OFF


def test_an_estop_ends_joint_control_at_once(controlled):
    driver = controlled()
    driver.robot.set_estop_level(EstopLevel.CUT)
    assert driver.stream.failure is not None
    assert "the e-stop was pressed (cut)" in driver.stream.failure.message


def test_a_fall_is_a_behaviour_fault_that_ends_joint_control(controlled):
    driver = controlled()
    pose = driver.robot.truth().joint_position_rad
    driver.robot.inject("push", {"roll_rad_s": 9.0, "up_m_s": 1.0}, None)
    driver.hold(1.2, pose)
    snapshot = driver.robot.snapshot()
    assert [fault.cause for fault in snapshot.behavior_faults] == ["fall"]
    assert driver.robot.truth().has_fallen
    assert driver.stream.failure is not None
    assert "tilted by" in driver.stream.failure.message
    driver.run(4.0)
    assert driver.robot.snapshot().mode is Mode.SITTING


def test_it_rights_itself(standing):
    driver = standing()
    driver.robot.inject("push", {"roll_rad_s": 9.0, "up_m_s": 1.5}, None)
    driver.run(5.0)
    assert driver.robot.truth().world_from_body_wxyz[0] ** 2 < 0.75
    driver.robot.selfright()
    driver.run(3.5)
    _, x, y, _ = driver.robot.truth().world_from_body_wxyz
    assert 1 - 2 * (x * x + y * y) > 0.95
    assert driver.robot.snapshot().mode is Mode.SITTING
    driver.robot.clear_behavior_fault(driver.robot.snapshot().behavior_faults[0].fault_id)
    driver.robot.stand()
    driver.run(2.5)
    assert driver.robot.truth().body_height_m == pytest.approx(0.52, abs=0.02)


def test_freezing_holds_the_joints(standing):
    driver = standing()
    before = driver.robot.truth().joint_position_rad
    driver.robot.freeze()
    driver.run(1.0)
    assert driver.robot.snapshot().mode is Mode.FROZEN
    np.testing.assert_allclose(driver.robot.truth().joint_position_rad, before, atol=0.12)
    driver.robot.stop_motion()
    assert driver.robot.snapshot().mode is Mode.STANDING_UP


def test_standing_costs_energy_and_warms_what_bears_most(standing):
    driver = standing(motors={"ambient_c": 22.0, "start_temperature_c": 22.0})
    before = driver.robot.snapshot()
    driver.run(3.0)
    after = driver.robot.snapshot()
    assert after.battery_charge_percent < before.battery_charge_percent
    assert after.battery_current_a < 0.0
    assert after.battery_voltage_v < 58.8
    losses = facts.per_joint(0.045, 0.045, 0.025) * driver.robot.truth().joint_torque_nm ** 2
    warming = {joint: after.motor_temperature_c[joint] - was for joint, was in before.motor_temperature_c.items()}
    warmest = max(warming, key=lambda joint: warming[joint])
    assert warmest[3:] == facts.JOINT_NAMES[int(losses.argmax())][3:]
    assert min(after.motor_temperature_c.values()) > 22.0


def test_an_almost_empty_battery_is_a_critical_fault(make):
    driver = make(battery={"charge_percent": 1.0})
    assert [(f.name, f.severity) for f in driver.robot.snapshot().system_faults] == [("battery_critical", "critical")]


def test_a_critical_battery_makes_it_sit_and_power_off(controlled):
    driver = controlled()
    driver.robot.inject("low_battery", {"percent": 1.0}, None)
    driver.run(0.003)
    assert "the battery is critically low" in driver.stream.failure.message
    assert driver.robot.snapshot().mode is Mode.SITTING_DOWN
    driver.run(2.5)
    assert driver.robot.snapshot().motor_power is MotorPower.OFF
    assert driver.robot.truth().body_height_m < 0.15


def test_a_diverged_simulation_is_a_fault_and_not_a_crash(standing):
    driver = standing()
    driver.robot._simulation.body.joint_velocity_rad_s[3] = np.nan
    driver.run(0.6)
    snapshot = driver.robot.snapshot()
    assert "simulation_diverged" in [fault.name for fault in snapshot.system_faults]
    assert snapshot.motor_power is MotorPower.OFF
    assert np.isfinite(driver.robot.truth().joint_position_rad).all()
    assert np.isfinite(driver.messages()[-1].joint_states.position).all()


# Time ----------------------------------------------------------------------------------------------------------------


def test_time_passes_only_when_asked(make):
    driver = make()
    start = driver.robot.clock.now_ns()
    driver.robot.start()
    assert driver.robot.clock.now_ns() == start
    driver.robot.advance(7_000_000)
    # Whole physics steps of 1.5 ms; the rest is kept for the next call.
    assert driver.robot.clock.now_ns() == start + 6_000_000
    driver.robot.advance(2_000_000)
    assert driver.robot.clock.now_ns() == start + 9_000_000
    driver.robot.stop()


def test_steps_of_states_hand_over_as_many(make):
    driver = make()
    for count in (1, 7, 6):
        before = driver.robot.states_sent
        driver.robot.advance_states(count)
        assert driver.robot.states_sent - before == count
    assert len(driver.messages()) == 14


def test_waiting_for_states_that_never_come_ends(make):
    driver = make()
    driver.robot.inject("state_gap", {}, None)
    start = driver.robot.clock.now_ns()
    driver.robot.advance_states(2)
    assert driver.robot.clock.now_ns() - start == pytest.approx(1_006_000_000, abs=3_000_000)
    start = driver.robot.clock.now_ns()
    driver.robot.advance_states(2, max_duration_ns=9_000_000)
    assert driver.robot.clock.now_ns() - start == 9_000_000


def test_a_real_time_robot_is_not_stepped():
    robot = Robot(Scenario())
    with pytest.raises(TimeModeError, match="time_mode: lock_step"):
        robot.advance(1)


def test_in_real_time_states_come_by_themselves():
    robot = Robot(Scenario())
    states = robot.subscribe_state()
    robot.start()
    try:
        got = [states.get(30.0) for _ in range(50)]
    finally:
        robot.stop()
    assert all(got)
    assert robot.crash is None
    stopped = robot.clock.now_ns()
    assert robot.clock.now_ns() == stopped
    assert states.is_closed


def test_extremes_start_afresh_on_request(standing):
    driver = standing()
    assert driver.robot.truth(reset_extremes=True).body_height_min_m < 0.1
    driver.run(0.3)
    assert driver.robot.truth().body_height_min_m > 0.5


def test_calls_from_many_threads_do_not_disturb_time(make):
    driver = make()
    errors: list[BaseException] = []

    def ask() -> None:
        try:
            for _ in range(100):
                driver.robot.snapshot()
                driver.robot.truth()
        except Exception as error:  # noqa: BLE001 - shown by the main thread
            errors.append(error)

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    start = driver.robot.clock.now_ns()
    driver.run(0.6)
    for thread in threads:
        thread.join()
    assert errors == []
    assert driver.robot.clock.now_ns() - start == 600_000_000


# Geometry of the stand -----------------------------------------------------------------------------------------------


def test_leg_angles_put_the_feet_where_they_belong():
    low = StandPose(forward_m=0.03, left_m=-0.02, height_m=-0.15, roll_rad=-0.05, pitch_rad=0.1, yaw_rad=-0.1)
    for pose in (StandPose(), StandPose(height_m=0.03, roll_rad=0.1, pitch_rad=-0.12, yaw_rad=0.15), low):
        feet = stand_feet_m(0.52, pose)
        angles = leg_angles_rad(feet[np.newaxis])[0]
        np.testing.assert_allclose(foot_position_in_body_m(angles), feet, atol=1e-9)
        assert (angles[2::3] < 0.0).all()


def test_paths_start_at_the_pose_and_end_in_the_stand():
    start = np.tile([0.2, 1.9, -2.6], 4)
    path = stand_path(start, is_low=True, duration_s=1.0, body_height_m=0.5, mass_kg=30.0, course=[StandPose()])
    np.testing.assert_allclose(path.at(0.0)[0], start)
    np.testing.assert_allclose(foot_position_in_body_m(path.at(9.0)[0]), stand_feet_m(0.5), atol=1e-9)
    assert np.abs(np.diff(path.position_rad, axis=0)).max() < 0.2
    course = [StandPose(forward_m=0.05, after_s=2.5), StandPose(left_m=9.0, after_s=5.0), StandPose(after_s=5.1)]
    path = stand_path(start, is_low=True, duration_s=1.0, body_height_m=0.5, mass_kg=30.0, course=course)
    # The rise comes first, each pose in its time, and a pose out of reach is cut to it; the last comes too soon.
    assert path.duration_s == pytest.approx(5.3)
    for time_s, pose in ((1.0, StandPose()), (2.5, course[0]), (5.0, StandPose(left_m=0.12)), (5.3, StandPose())):
        np.testing.assert_allclose(foot_position_in_body_m(path.at(time_s)[0]), stand_feet_m(0.5, pose), atol=1e-9)
    down = sit_path(path.at(9.0)[0], duration_s=1.0, mass_kg=30.0)
    np.testing.assert_allclose(down.at(0.0)[0], path.at(9.0)[0], atol=1e-9)
