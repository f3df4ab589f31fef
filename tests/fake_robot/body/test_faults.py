"""Every fault of the body really happens, ends, and is refused with its reasons when it makes no sense."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from bosdyn.api import robot_state_pb2
from google.protobuf.message import DecodeError

from fake_robot.faults.fault import FAULTS, Fault, ServiceFault
from fake_robot.network.status import Mode, MotorPower
from spot_model.errors import BadInputError

NS = 1_000_000_000


def stamps(messages) -> list[int]:
    return [
        m.joint_states.acquisition_timestamp.seconds * NS + m.joint_states.acquisition_timestamp.nanos for m in messages
    ]


def inject(driver, name: str, seconds: float | None = None, **parameters: float | str) -> int:
    fault_id: int = driver.robot.inject(name, parameters, seconds)
    return fault_id


def test_state_gap_loses_the_states_of_its_time(make):
    driver = make(state_channel={"delay": {"kind": "constant", "delay_s": 0.0}})
    driver.run(0.03)
    inject(driver, "state_gap", 0.015)
    driver.run(0.03)
    # States at +3, +6, +9, +12 ms are lost; the fault is over at +15 ms.
    gaps = np.diff(stamps(driver.messages()))
    assert gaps.max() == 15_000_000
    assert (gaps == 3_000_000).sum() == len(gaps) - 1


def test_state_delay_makes_states_older(make):
    driver = make(state_channel={"delay": {"kind": "constant", "delay_s": 0.0}})
    inject(driver, "state_delay", None, delay_s=0.015)
    driver.run(0.03)
    assert driver.robot.clock.now_ns() - stamps(driver.messages())[-1] == 15_000_000


@pytest.mark.parametrize("kind", ["eleven_joints", "cut", "noise", "empty"])
def test_malformed_states_are_no_states_of_a_spot(make, kind):
    driver = make()
    subscription = driver.robot.subscribe_state()
    fault = inject(driver, "malformed_states", None, kind=kind)
    driver.run(0.03)
    wire = subscription.get(0.0)
    driver.robot.clear_faults((fault,))
    try:
        state = robot_state_pb2.RobotStateStreamResponse.FromString(wire)
    except DecodeError:
        assert kind in {"cut", "noise"}
    else:
        assert len(state.joint_states.position) == {"eleven_joints": 11, "empty": 0}[kind]
        assert len(state.contact_states) == (4 if kind == "eleven_joints" else 0)


def test_state_jitter_and_drops(make):
    driver = make(state_channel={"delay": {"kind": "constant", "delay_s": 0.0}})
    inject(driver, "state_jitter", None, mean_s=0.02)
    driver.run(0.3)
    assert driver.robot.states_sent < 100
    driver.robot.clear_faults(())
    driver.run(0.3)
    driver.messages()
    inject(driver, "state_drops", None, probability=0.5)
    driver.run(1.5)
    assert 150 < len(driver.messages()) < 350


def test_command_delay_and_jitter_reach_the_echo(controlled):
    driver = controlled(command_channel={"delay": {"kind": "constant", "delay_s": 0.0}})
    pose = driver.robot.truth().joint_position_rad
    for name, parameters in (("command_delay", {"delay_s": 0.009}), ("command_jitter", {"mean_s": 0.01})):
        fault = inject(driver, name, None, **parameters)
        sent_ns = driver.robot.clock.now_ns()
        driver.hold(0.042, pose)
        received = driver.messages()[-1].last_command.received_timestamp
        # The echo names the command that arrived last, which was sent at the start or one tick later.
        assert (received.seconds * NS + received.nanos - sent_ns) % 21_000_000 > 0
        driver.robot.clear_faults((fault,))
        driver.hold(0.1, pose)
    assert driver.stream.failure is None


def test_command_drops_are_never_received(controlled):
    driver = controlled()
    before = driver.robot.snapshot().joint_commands_received
    inject(driver, "command_drops", None, probability=1.0)
    driver.hold(0.042)
    assert driver.robot.snapshot().joint_commands_received == before
    driver.run(0.1)
    assert driver.robot.snapshot().mode is Mode.DAMPING


def test_duplicated_and_back_dated_states(make):
    driver = make()
    inject(driver, "duplicated_states", 0.3, probability=0.5)
    driver.run(0.33)
    gaps = np.diff(stamps(driver.messages()))
    assert (gaps == 0).sum() > 20
    inject(driver, "back_dated_states", 0.3, probability=0.3, shift_s=0.02)
    driver.run(0.33)
    assert np.diff(stamps(driver.messages())).min() <= -17_000_000


def test_frozen_sensors_stay_while_stamps_go_on(controlled):
    driver = controlled()
    fault = inject(driver, "frozen_sensors")
    pose = driver.robot.truth().joint_position_rad
    driver.run(0.009)
    driver.messages()
    driver.hold(0.1, pose)
    frozen = driver.messages()
    assert len({tuple(m.joint_states.position) for m in frozen}) == 1
    assert set(np.diff(stamps(frozen))) == {3_000_000}
    driver.robot.clear_faults((fault,))
    driver.hold(0.1, pose)
    assert len({tuple(m.joint_states.position) for m in driver.messages()}) > 20


@pytest.mark.parametrize("signal", ["position", "velocity", "load", "attitude", "body_velocity", "imu"])
def test_one_signal_turns_into_nan(make, signal: str):
    driver = make()
    inject(driver, "nan_sensor", None, signal=signal)
    driver.run(0.03)
    message = driver.messages()[-1]
    values = {
        "position": message.joint_states.position[0],
        "velocity": message.joint_states.velocity[0],
        "load": message.joint_states.load[0],
        "attitude": message.kinematic_state.odom_tform_body.rotation.w,
        "body_velocity": message.kinematic_state.velocity_of_body_in_odom.linear.x,
        "imu": message.inertial_state.packets[0].acceleration_rt_odom_in_link_frame.x,
    }
    assert [name for name, value in values.items() if np.isnan(value)] == [signal]


def test_a_bad_quaternion_has_the_length_asked_for(make):
    driver = make()
    inject(driver, "bad_quaternion", None, scale=0.5)
    driver.run(0.03)
    q = driver.messages()[-1].kinematic_state.odom_tform_body.rotation
    assert np.linalg.norm([q.w, q.x, q.y, q.z]) == pytest.approx(0.5, abs=1e-6)


def test_the_clock_jumps_and_jumps_back(make):
    driver = make()
    before = driver.robot.clock.now_ns()
    inject(driver, "clock_jump", 0.03, jump_s=1.0)
    assert driver.robot.clock.now_ns() == before + NS
    driver.run(0.06)
    assert driver.robot.clock.now_ns() == before + 60_000_000
    gaps = np.diff(stamps(driver.messages()))
    assert gaps.min() == 3_000_000 - NS


def test_battery_and_temperature_faults_are_reported(make):
    driver = make()
    assert driver.robot.snapshot().system_faults == ()
    inject(driver, "low_battery", None, percent=1.5)
    inject(driver, "battery_fault")
    inject(driver, "motor_over_temperature", None, joint="hr_kn", temperature_c=120.0)
    inject(driver, "system_fault", None, fault_name="odd_noise", severity="warn", message="clicks")
    snapshot = driver.robot.snapshot()
    assert snapshot.battery_charge_percent == 1.5
    assert snapshot.motor_temperature_c["hr_kn"] == 120.0
    assert {(f.name, f.severity) for f in snapshot.system_faults} == {
        ("battery_fault", "critical"),
        ("battery_critical", "critical"),
        ("motor_over_temperature_hr_kn", "critical"),
        ("odd_noise", "warn"),
    }
    driver.robot.clear_faults(())
    assert driver.robot.snapshot().system_faults == ()


def test_a_dead_motor_gives_no_torque(controlled):
    driver = controlled()
    inject(driver, "weak_motor", None, joint="fl_kn", gain=0.0)
    driver.run(0.003)
    torque = driver.robot.truth().joint_torque_nm
    assert torque[2] == 0.0
    assert np.abs(np.delete(torque, 2)[1::3]).max() > 1.0


def test_a_behaviour_fault_ends_joint_control_and_stays(controlled):
    driver = controlled()
    fault = inject(driver, "behavior_fault", None, cause="hardware")
    assert driver.robot.snapshot().mode is Mode.DAMPING
    driver.robot.clear_faults((fault,))
    driver.run(0.1)
    assert [f.cause for f in driver.robot.snapshot().behavior_faults] == ["hardware"]


def test_power_loss_cuts_the_motors(controlled):
    driver = controlled()
    inject(driver, "power_loss")
    driver.run(0.5)
    assert driver.robot.snapshot().motor_power is MotorPower.OFF
    assert "lost power" in driver.stream.failure.message


def test_a_push_moves_the_body(standing):
    driver = standing()
    inject(driver, "push", None, left_m_s=0.5)
    assert driver.robot.truth().linear_vel_of_body_in_world_m_s[1] == pytest.approx(0.5, abs=0.02)


def test_faults_end_by_time_and_by_number(make):
    driver = make()
    first = inject(driver, "state_delay", 0.03, delay_s=0.1)
    second = inject(driver, "state_gap", None)
    assert driver.robot.active_faults() == {first: "state_delay", second: "state_gap"}
    driver.run(0.033)
    assert driver.robot.active_faults() == {second: "state_gap"}
    assert driver.robot.clear_faults((first, second)) == (second,)
    assert driver.robot.active_faults() == {}


@pytest.mark.parametrize(
    ("name", "parameters", "parts"),
    [
        ("earthquake", {}, ["no fault 'earthquake'", "state_gap", "push"]),
        ("state_delay", {}, ["state_delay", "delay_s", "required"]),
        ("state_delay", {"delay_s": -1.0}, ["delay_s = -1.0", "greater than or equal to 0"]),
        ("state_delay", {"delay": 1.0}, ["delay = 1.0: unknown key; allowed: delay_s"]),
        ("nan_sensor", {"signal": "smell"}, ["signal = 'smell'", "'position'"]),
    ],
)
def test_a_bad_fault_is_refused_in_words(make, name: str, parameters: dict[str, float | str], parts: list[str]):
    with pytest.raises(BadInputError) as caught:
        make().robot.inject(name, parameters, None)
    for part in parts:
        assert part in str(caught.value)


def test_every_fault_says_what_it_does_and_what_its_parameters_mean():
    for fault in FAULTS.values():
        assert (fault.__doc__ or "").strip().endswith(".")
        assert all(field.description for field in fault.model_fields.values())


def test_every_fault_is_tried_here():
    """By the names in this file: its tests may run in several processes."""
    names = {name for name, fault in FAULTS.items() if not issubclass(fault, ServiceFault)}
    assert names <= set(re.findall(r'"(\w+)"', Path(__file__).read_text()))


def test_a_new_fault_is_one_class(make) -> None:
    class Nudge(Fault, name="thrown_away_nudge"):
        """The body is nudged upwards."""

        def start(self, simulation) -> None:
            simulation.body.push(np.array([0.0, 0.0, 1.0]), np.zeros(3))

    try:
        driver = make()
        driver.robot.inject("thrown_away_nudge", {}, None)
        assert driver.robot.truth().linear_vel_of_body_in_world_m_s[2] > 0.9
    finally:
        del FAULTS["thrown_away_nudge"]
