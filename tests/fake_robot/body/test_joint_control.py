"""Joint control: what a message must hold, which statuses end a stream, and what the servos do."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bosdyn.api import robot_command_pb2

from fake_robot.body.drive import LOAD_LIMIT_NM
from fake_robot.network.status import Mode
from fake_robot.robot.streamed_command import StreamGrammar
from spot_model.robot import facts

NS = 1_000_000_000
STATUS = robot_command_pb2.JointControlStreamResponse


def change_gains_in_part(command: Any) -> None:
    del command.gains.k_qd_p[:]


INVALID: dict[str, tuple[Callable[[Any], None], str]] = {
    "no end": (lambda r: r.joint_command.ClearField("end_time"), "end_time is missing"),
    "no command": (lambda r: r.ClearField("joint_command"), "joint_command is missing"),
    "11 positions": (lambda r: r.joint_command.position.pop(), "position has 11 values; allowed: 12"),
    "no velocity": (lambda r: r.joint_command.ClearField("velocity"), "velocity has 0 values; allowed: 12"),
    "19 loads": (lambda r: r.joint_command.load.extend([0.0] * 7), "load has 19 values; allowed: 12"),
    "no gains": (lambda r: r.joint_command.ClearField("gains"), "the first message has no gains"),
    "gains in part": (lambda r: change_gains_in_part(r.joint_command), "k_qd_p is missing"),
    "short gains": (lambda r: r.joint_command.gains.k_q_p.pop(), "gains.k_q_p has 11 values"),
    "negative gain": (lambda r: r.joint_command.gains.k_q_p.__setitem__(3, -1.0), "holds -1; allowed: 0 and above"),
    "NaN": (lambda r: r.joint_command.position.__setitem__(3, float("nan")), "position holds a value that is no"),
    "infinite": (lambda r: r.joint_command.load.__setitem__(3, float("inf")), "load holds a value that is no"),
    "three advices": (lambda r: r.contact_advice.contact_advice.extend([1, 1, 1]), "contact_advice has 3 values"),
    "zero limit": (lambda r: setattr(r.joint_command.velocity_safety_limit, "value", 0.0), "velocity_safety_limit = 0"),
}


@pytest.mark.parametrize("name", INVALID)
def test_an_invalid_message_ends_the_stream(make, name: str):
    driver = make()
    driver.open()
    request = driver.request()
    change, text = INVALID[name]
    change(request)
    driver.robot.submit(driver.stream, request)
    failure = driver.stream.failure
    assert failure is not None
    assert failure.status == STATUS.STATUS_INVALID_REQUEST
    assert text in failure.message
    assert driver.failures == 1


def test_gains_hold_until_they_change():
    grammar = StreamGrammar()
    first = _request(1)
    first.joint_command.gains.k_q_p.extend([60.0] * 12)
    first.joint_command.gains.k_qd_p.extend([1.5] * 12)
    grammar.read(first)
    assert grammar.read(_request(2)).servo.kp_nm_per_rad[0, 0] == 60.0
    changed = _request(3)
    changed.joint_command.gains.k_q_p.extend([70.0] * 12)
    changed.joint_command.gains.k_qd_p.extend([1.0] * 12)
    grammar.read(changed)
    assert grammar.read(_request(4)).servo.kp_nm_per_rad[0, 0] == 70.0


def test_a_velocity_limit_holds_for_its_message_and_a_key_is_optional():
    grammar = StreamGrammar()
    first = _request(0)
    first.joint_command.gains.k_q_p.extend([60.0] * 12)
    first.joint_command.gains.k_qd_p.extend([1.5] * 12)
    first.joint_command.velocity_safety_limit.value = 20.0
    read = grammar.read(first)
    assert (read.key, read.velocity_limit_rad_s) == (0, 20.0)
    assert grammar.read(_request(0)).velocity_limit_rad_s is None


def test_setpoints_and_loads_saturate():
    request = _request(1, position=[9.0] * 6 + [-9.0] * 6, load=[500.0] * 12)
    request.joint_command.gains.k_q_p.extend([60.0] * 12)
    request.joint_command.gains.k_qd_p.extend([1.5] * 12)
    servo = StreamGrammar().read(request).servo
    np.testing.assert_array_equal(servo.position_rad[0, :6], facts.POSITION_HIGH_RAD[:6])
    np.testing.assert_array_equal(servo.position_rad[0, 6:], facts.POSITION_LOW_RAD[6:])
    np.testing.assert_array_equal(servo.load_nm[0], LOAD_LIMIT_NM)
    assert LOAD_LIMIT_NM[:2].tolist() == [45.0, 45.0]


def test_extrapolation_follows_the_velocity_for_its_duration():
    request = _request(1, position=[0.1] * 12, velocity=[0.5] * 12)
    command = request.joint_command
    command.gains.k_q_p.extend([60.0] * 12)
    command.gains.k_qd_p.extend([1.5] * 12)
    command.reference_time.seconds = 100
    command.extrapolation_duration.nanos = 40_000_000
    read = StreamGrammar().read(request)
    hip = [float(read.servo_at(100 * NS + ms * 1_000_000).position_rad[0, 0]) for ms in (-10, 0, 20, 40, 400)]
    np.testing.assert_allclose(hip, [0.1, 0.1, 0.11, 0.12, 0.12], atol=1e-7)
    # Without a reference time it starts when the robot has the command.
    command.ClearField("reference_time")
    arrived = StreamGrammar().read(request).received_at(200 * NS)
    hip = [float(arrived.servo_at(200 * NS + ms * 1_000_000).position_rad[0, 0]) for ms in (0, 20, 40, 400)]
    np.testing.assert_allclose(hip, [0.1, 0.11, 0.12, 0.12], atol=1e-7)
    assert read.received_at(200 * NS) is read
    # The knee saturates at its limit on the way.
    assert float(read.servo_at(101 * NS).position_rad[0, 2]) == facts.POSITION_HIGH_RAD[2]


@pytest.mark.parametrize("order", ["stream, then activate", "activate, then stream"])
def test_both_orders_of_activation(standing, order: str):
    driver = standing()
    pose = driver.robot.truth().joint_position_rad
    if order.startswith("stream"):
        driver.open()
        driver.hold(0.1, pose)
        driver.robot.enter_joint_control()
    else:
        driver.robot.enter_joint_control()
        driver.run(0.1)
        driver.open()
    target = pose + np.tile([0.0, 0.05, -0.1], 4)
    driver.hold(0.5, target)
    assert driver.robot.snapshot().mode is Mode.JOINT_CONTROL
    assert driver.stream.failure is None
    moved = driver.robot.truth().joint_position_rad - pose
    assert (moved[2::3] < -0.07).all()
    assert (moved[1::3] > 0.01).all()


def test_a_stream_without_activation_is_inactive_after_the_wait(standing):
    driver = standing(joint_control={"activation_wait_s": 0.5})
    driver.open()
    driver.hold(0.45)
    assert driver.stream.failure is None
    driver.hold(0.1)
    assert driver.stream.failure.status == STATUS.STATUS_INACTIVE
    assert "the robot is standing, not in joint control, for 0.5 s" in driver.stream.failure.message


def test_activation_without_a_stream_returns_to_the_stand(standing):
    driver = standing(joint_control={"activation_wait_s": 0.5})
    driver.robot.enter_joint_control()
    driver.run(0.4)
    assert driver.robot.snapshot().mode is Mode.JOINT_CONTROL
    driver.run(0.2)
    assert driver.robot.snapshot().mode is Mode.STANDING_UP
    driver.run(1.5)
    assert driver.robot.snapshot().mode is Mode.STANDING
    assert driver.robot.truth().body_height_min_m > 0.08


def test_a_stand_request_leaves_joint_control_and_the_stream_may_go_on(controlled):
    driver = controlled()
    driver.robot.stand()
    driver.hold(0.5)
    assert driver.stream.failure is None
    driver.run(1.0)
    assert driver.robot.snapshot().mode is Mode.STANDING


def test_a_late_command_is_expired(standing):
    driver = standing(command_channel={"delay": {"kind": "constant", "delay_s": 0.05}})
    driver.open()
    driver.send(ahead_s=0.04)
    driver.run(0.06)
    failure = driver.stream.failure
    assert failure.status == STATUS.STATUS_EXPIRED
    assert "arrived 10.0 ms after its end_time" in failure.message


@pytest.mark.parametrize(("ahead_s", "status"), [(-0.01, STATUS.STATUS_EXPIRED), (20.0, STATUS.STATUS_TOO_DISTANT)])
def test_what_is_over_or_far_off_when_it_is_sent_is_refused_at_once(make, ahead_s: float, status: int):
    # A client may close its end right after its only message, and is told the verdict then.
    driver = make()
    driver.open()
    driver.send(ahead_s=ahead_s)
    assert driver.stream.failure.status == status
    assert driver.robot.wait_for_command_key(driver.key, 0.0)


def test_an_end_too_far_ahead_is_too_distant(standing):
    driver = standing(joint_control={"max_end_time_ahead_s": 1.0})
    driver.open()
    driver.send(ahead_s=2.0)
    driver.run(0.02)
    assert driver.stream.failure.status == STATUS.STATUS_TOO_DISTANT
    assert "allowed: 1 s" in driver.stream.failure.message


def test_a_first_setpoint_far_away_is_too_distant_where_the_policy_says_so(standing):
    driver = standing(joint_control={"max_first_setpoint_distance_rad": 0.3})
    pose = driver.robot.truth().joint_position_rad
    driver.open()
    driver.robot.enter_joint_control()
    driver.send(pose + np.tile([0.0, 0.4, 0.0], 4))
    driver.run(0.02)
    assert driver.stream.failure.status == STATUS.STATUS_TOO_DISTANT
    assert re.search(r"first set-point of .._hy lies 0\.4.*allowed: 0\.3 rad", driver.stream.failure.message)


def test_commands_have_no_effect_before_they_arrive(controlled):
    driver = controlled(command_channel={"delay": {"kind": "constant", "delay_s": 0.006}})
    driver.hold(0.21)
    before = driver.robot.truth().joint_torque_nm
    driver.send(driver.robot.truth().joint_position_rad + np.tile([0.0, 0.2, 0.0], 4))
    driver.run(0.006)
    np.testing.assert_allclose(driver.robot.truth().joint_torque_nm, before, atol=3.0)
    driver.run(0.003)
    assert np.abs(driver.robot.truth().joint_torque_nm - before)[1::3].min() > 20.0


def test_motor_torque_is_the_servo_law(controlled):
    driver = controlled(model={"effects": []})
    target = driver.robot.truth().joint_position_rad + 0.01
    for _ in range(10):
        request = driver.request(target)
        del request.joint_command.gains.k_q_p[:], request.joint_command.gains.k_qd_p[:]
        request.joint_command.gains.k_q_p.extend([350.0] * 12)
        request.joint_command.gains.k_qd_p.extend([6.0] * 12)
        driver.robot.submit(driver.stream, request)
        driver.run(0.021)
    simulation = driver.robot._simulation
    position, velocity = simulation.body.joint_position_rad.copy(), simulation.body.joint_velocity_rad_s.copy()
    simulation.step()
    expected = 350.0 * (np.float32(target) - position) - 6.0 * velocity
    np.testing.assert_allclose(simulation.body.motor_torque_nm, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("policy", "modes"),
    [
        ("damp", [Mode.DAMPING, Mode.SITTING]),
        ("hold_vendor_stand", [Mode.STANDING_UP, Mode.STANDING]),
        ("freeze_torque", [Mode.FROZEN, Mode.SITTING]),
    ],
)
def test_an_expired_command_ends_in_the_named_policy(controlled, policy: str, modes: list[Mode]):
    driver = controlled(joint_control={"on_command_expiry": policy})
    driver.hold(0.2)
    driver.run(0.08)
    snapshot = driver.robot.snapshot()
    assert snapshot.mode is modes[0]
    assert snapshot.is_joint_control_failed
    assert driver.stream.failure.status == STATUS.STATUS_EXPIRED
    assert f"command {driver.key} ended" in driver.stream.failure.message
    driver.run(4.5)
    assert driver.robot.snapshot().mode is modes[1]
    expected = 0.52 if policy == "hold_vendor_stand" else 0.1
    assert driver.robot.truth().body_height_m == pytest.approx(expected, abs=0.05)


def test_an_expired_command_stops_within_two_physics_steps_of_its_end(controlled):
    driver = controlled()
    driver.send(ahead_s=0.03)
    end_ns = driver.robot.clock.now_ns() + 30_000_000
    while driver.robot.snapshot().mode is Mode.JOINT_CONTROL:
        driver.run(0.0015)
    assert 0 <= driver.robot.clock.now_ns() - end_ns <= 6_000_000


def test_a_closed_stream_leaves_its_last_command_until_it_ends(controlled):
    driver = controlled()
    driver.send(ahead_s=0.06)
    driver.robot.close_stream(driver.stream)
    driver.run(0.04)
    assert driver.robot.snapshot().mode is Mode.JOINT_CONTROL
    driver.run(0.04)
    assert driver.robot.snapshot().mode is Mode.DAMPING
    assert driver.stream.failure is None


def test_a_command_that_arrives_late_on_a_closed_stream_hurts_nobody(standing):
    driver = standing(command_channel={"delay": {"kind": "constant", "delay_s": 0.05}})
    driver.open()
    driver.send(ahead_s=0.02)
    driver.robot.close_stream(driver.stream)
    driver.run(0.1)
    assert driver.robot.snapshot().joint_commands_received == 1


def test_a_joint_above_the_velocity_limit_is_a_behaviour_fault(standing):
    driver = standing()
    pose = driver.robot.truth().joint_position_rad
    driver.open()
    driver.robot.enter_joint_control()
    request = driver.request(pose + np.tile([0.0, 0.3, -0.6], 4))
    request.joint_command.velocity_safety_limit.value = 1.0
    driver.robot.submit(driver.stream, request)
    driver.run(0.05)
    snapshot = driver.robot.snapshot()
    assert [fault.cause for fault in snapshot.behavior_faults] == ["command_failure"]
    assert snapshot.mode is Mode.DAMPING
    assert driver.stream.failure.status == STATUS.STATUS_INACTIVE
    assert "velocity_safety_limit = 1" in driver.stream.failure.message


def test_waiting_for_a_key_sees_what_was_submitted(make):
    driver = make()
    driver.open()
    driver.send()
    assert driver.robot.wait_for_command_key(1, 0.0)
    assert not driver.robot.wait_for_command_key(2, 0.0)
    assert driver.robot.commands_submitted == 1
    assert not driver.robot.wait_for_command_key(1, 0.0, beyond=1)
    driver.send()
    assert driver.robot.wait_for_command_key(1, 0.0, beyond=1)


def test_state_to_command_received_is_four_to_five_milliseconds(standing):
    """A client that answers each state at once: from acquisition to receipt, default channels."""
    driver = standing()
    driver.open()
    driver.messages()
    delays_ms: dict[int, float] = {}
    key_of_stamp: dict[int, int] = {}
    for _ in range(1200):
        driver.run(0.0015)
        for message in driver.messages():
            acquired = message.joint_states.acquisition_timestamp
            driver.send(np.zeros(12))
            key_of_stamp[driver.key] = acquired.seconds * NS + acquired.nanos
            key = message.last_command.user_command_key
            if key:
                received = message.last_command.received_timestamp
                delays_ms[key] = (received.seconds * NS + received.nanos - key_of_stamp[key]) * 1e-6
    # The client looks every 1.5 ms, which adds 0.75 ms on average to the channels' 4.5 ms.
    waits_ms = 0.75
    assert len(delays_ms) > 400
    assert 4.0 < np.median(list(delays_ms.values())) - waits_ms < 5.0


def _request(key: int, *, position: Any = None, velocity: Any = None, load: Any = None) -> Any:
    request = robot_command_pb2.JointControlStreamRequest()
    command = request.joint_command
    command.user_command_key = key
    command.end_time.seconds = 5
    command.position.extend([-0.5] * 12 if position is None else position)
    command.velocity.extend([0.0] * 12 if velocity is None else velocity)
    command.load.extend([0.0] * 12 if load is None else load)
    return request
