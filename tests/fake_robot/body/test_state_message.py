"""The state stream: its period, its stamps, and the oddities of a real message."""

from __future__ import annotations

import numpy as np
import pytest
from bosdyn.api import header_pb2, robot_state_pb2

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.body.sensing import IMU_PACKETS, Frame
from fake_robot.robot.state_message import StateMessageBuilder
from spot_model.robot.rotation import multiply_wxyz, rotate_inverse_wxyz, rotate_wxyz

NS = 1_000_000_000


def stamp_ns(stamp) -> int:
    return stamp.seconds * NS + stamp.nanos


def wxyz(q) -> np.ndarray:
    return np.array([q.w, q.x, q.y, q.z])


def vector(v) -> np.ndarray:
    return np.array([v.x, v.y, v.z])


def quiet() -> dict[str, float]:
    """Sensors without noise."""
    names = ("position_rad", "velocity_rad_s", "load_nm", "body_velocity_m_s", "body_angular_velocity_rad_s")
    return dict.fromkeys((*names, "attitude_rad", "imu_acceleration_m_s2", "imu_angular_velocity_rad_s"), 0.0)


def test_states_come_every_three_milliseconds_of_robot_time_exactly(make):
    driver = make()
    driver.run(1.0)
    stamps = [stamp_ns(m.joint_states.acquisition_timestamp) for m in driver.messages()]
    assert 330 <= len(stamps) <= 333
    assert set(np.diff(stamps)) == {3_000_000}
    assert stamps[0] == 1_700_000_000 * NS - 199_190_000_000 + 3_000_000


def test_a_message_has_the_oddities_of_a_real_one(standing):
    driver = standing()
    message = driver.messages()[-1]
    acquired = stamp_ns(message.joint_states.acquisition_timestamp)
    assert message.header.error.code == header_pb2.CommonError.CODE_UNSPECIFIED
    assert stamp_ns(message.header.request_received_timestamp) - acquired == 900_000
    assert message.inertial_state.packet_rate == 0.001
    packets = message.inertial_state.packets
    assert [acquired - stamp_ns(p.timestamp) for p in packets] == [2_000_000, 1_000_000, 0]
    body, imu = wxyz(message.kinematic_state.odom_tform_body.rotation), wxyz(packets[-1].odom_rot_link)
    assert body @ imu == pytest.approx(-1.0, abs=1e-4)
    assert message.kinematic_state.odom_tform_body.position.z == pytest.approx(0.19, abs=0.01)
    assert driver.robot.truth().body_height_m == pytest.approx(0.52, abs=0.01)
    assert [len(v) for v in (message.joint_states.position, message.joint_states.load, message.contact_states)] == [
        12,
        12,
        4,
    ]
    assert not message.HasField("last_command")


def test_contacts_are_made_standing_and_lost_in_the_air(standing):
    driver = standing()
    assert list(driver.messages()[-1].contact_states) == [robot_state_pb2.FootState.CONTACT_MADE] * 4
    driver.robot.inject("push", {"up_m_s": 2.0}, None)
    driver.run(0.1)
    assert list(driver.messages()[-1].contact_states) == [robot_state_pb2.FootState.CONTACT_LOST] * 4


def test_the_echo_names_the_newest_command_and_when_it_came(controlled):
    driver = controlled(command_channel={"delay": {"kind": "constant", "delay_s": 0.004}})
    sent_ns = driver.robot.clock.now_ns()
    driver.send()
    driver.run(0.021)
    echo = driver.messages()[-1].last_command
    assert echo.user_command_key == driver.key
    assert stamp_ns(echo.received_timestamp) - sent_ns == 4_000_000


def test_without_noise_a_message_tells_the_truth(standing):
    driver = standing(sensors=quiet())
    driver.robot.inject("push", {"forward_m_s": 0.3, "yaw_rad_s": 0.5}, None)
    driver.run(0.102)
    message, truth = driver.messages()[-1], driver.robot.truth()
    # The newest message may be one or two periods old: it is still under way for 1.5 ms.
    state = truth
    assert stamp_ns(message.joint_states.acquisition_timestamp) >= truth.robot_stamp_ns - 6_000_000
    np.testing.assert_allclose(message.joint_states.position, state.joint_position_rad, atol=5e-3)
    kinematics, frames = message.kinematic_state, driver.robot.scenario.frames
    for pose, velocity, origin, yaw in (
        (kinematics.odom_tform_body, kinematics.velocity_of_body_in_odom, frames.odom_position_m, frames.odom_yaw_rad),
        (
            kinematics.vision_tform_body,
            kinematics.velocity_of_body_in_vision,
            frames.vision_position_m,
            frames.vision_yaw_rad,
        ),
    ):
        world_from_frame = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        in_world = rotate_wxyz(world_from_frame, vector(pose.position)) + np.array(origin)
        np.testing.assert_allclose(in_world, state.position_of_body_in_world_m, atol=3e-3)
        attitude = multiply_wxyz(world_from_frame, wxyz(pose.rotation))
        assert abs(attitude @ state.world_from_body_wxyz) == pytest.approx(1.0, abs=1e-5)
        linear = rotate_wxyz(world_from_frame, vector(velocity.linear))
        np.testing.assert_allclose(linear, state.linear_vel_of_body_in_world_m_s, atol=0.05)
        angular = rotate_inverse_wxyz(attitude, rotate_wxyz(world_from_frame, vector(velocity.angular)))
        np.testing.assert_allclose(angular, state.angular_vel_of_body_in_body_rad_s, atol=0.1)


def test_at_rest_the_imu_feels_gravity_alone(standing):
    driver = standing(sensors=quiet())
    driver.run(1.0)
    for packet in driver.messages()[-1].inertial_state.packets:
        np.testing.assert_allclose(vector(packet.acceleration_rt_odom_in_link_frame), [0, 0, 9.81], atol=0.05)
        np.testing.assert_allclose(vector(packet.angular_velocity_rt_odom_in_link_frame), 0.0, atol=0.01)


def test_in_free_fall_the_imu_feels_nothing(standing):
    driver = standing(sensors=quiet())
    driver.robot.inject("push", {"up_m_s": 2.0}, None)
    # Without power the legs hardly pull at the body.
    driver.robot.power_off()
    driver.run(0.1)
    acceleration = vector(driver.messages()[-1].inertial_state.packets[-1].acceleration_rt_odom_in_link_frame)
    np.testing.assert_allclose(acceleration, 0.0, atol=1.5)


@pytest.mark.parametrize("substeps", [1, 2, 3])
def test_packets_follow_the_turn_between_physics_steps(make, substeps: int):
    driver = make(sensors=quiet(), physics={"substeps_per_state": substeps})
    sensing = driver.robot._simulation.sensing
    # A turn rate that grows evenly over the period: 1, 2, 3 rad/s at 1, 2, 3 ms.
    for row in range(substeps + 1):
        sensing._samples[row, 5] = 3.0 * row / substeps
    report = sensing.report(0, FaultEffects())
    np.testing.assert_allclose(report.imu_angular_velocity_rad_s[:, 2], [1.0, 2.0, 3.0], atol=1e-9)
    assert report.imu_wxyz.shape == (IMU_PACKETS, 4)


def test_an_imu_off_centre_feels_the_turn(make):
    # By hand: at 2 rad/s about z, 0.1 m ahead, the centripetal acceleration is 0.4 m/s² backwards.
    forces = []
    for x in (0.0, 0.1):
        driver = make(sensors={**quiet(), "imu_from_body_m": [x, 0.0, 0.0]})
        driver.robot.inject("push", {"up_m_s": 2.0, "yaw_rad_s": 2.0}, None)
        driver.run(0.03)
        forces.append(vector(driver.messages()[-1].inertial_state.packets[-1].acceleration_rt_odom_in_link_frame))
    rate = driver.robot.truth().angular_vel_of_body_in_body_rad_s[2]
    assert forces[1][0] - forces[0][0] == pytest.approx(-0.1 * rate**2, abs=0.02)


def test_load_is_what_bears_the_robot(standing):
    driver = standing(sensors=quiet())
    driver.run(1.0)
    load = np.array(driver.messages()[-1].joint_states.load)
    torque = driver.robot.truth().joint_torque_nm
    # At rest, link-side torque is motor torque up to friction.
    np.testing.assert_allclose(load, torque, atol=0.25)
    assert np.abs(load[2::3]).min() > 5.0


def test_reused_messages_forget_what_was_in_them(make):
    driver = make()
    simulation = driver.robot._simulation
    builder = StateMessageBuilder(driver.robot.scenario, Frame((0, 0, 0), 0.0), Frame((0, 0, 0), 0.0))
    first = builder.build(simulation.report, NS, 0, 0)
    builder.build(simulation.report._replace(foot_contact=np.ones(4, dtype=bool)), 2 * NS, 0, 0)
    assert builder.build(simulation.report, NS, 0, 0) == first


def test_the_same_seed_repeats_bit_for_bit(make):
    def wires(seed: int) -> list[bytes]:
        driver = make(seed=seed, command_channel={"delay": {"kind": "gamma", "shape": 2.0, "scale_s": 0.002}})
        driver.stand_up()
        driver.open()
        driver.robot.enter_joint_control()
        driver.hold(0.5)
        return [m.SerializeToString(deterministic=True) for m in driver.messages()]

    assert wires(5) == wires(5)
    assert wires(5) != wires(6)


def test_a_late_reader_gets_every_message_in_order(make):
    driver = make(state_channel={"delay": {"kind": "gamma", "shape": 0.5, "scale_s": 0.02}})
    driver.run(1.0)
    driver.run(1.0)
    stamps = [stamp_ns(m.joint_states.acquisition_timestamp) for m in driver.messages()]
    assert set(np.diff(stamps)) == {3_000_000}


def test_a_closed_subscription_ends_and_gets_no_more(make):
    driver = make()
    driver.states.close()
    assert driver.states.is_closed
    driver.run(0.1)
    assert driver.states.get(0.0) is None


def test_a_state_arrives_after_its_delay(make):
    driver = make(state_channel={"delay": {"kind": "constant", "delay_s": 0.0075}})
    driver.run(0.0105)
    assert [stamp_ns(m.joint_states.acquisition_timestamp) % NS for m in driver.messages()] == [813_000_000]
