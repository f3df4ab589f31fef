"""The conformance suite: right robots pass, wrong ones do not, and a suite without motion gives nobody power."""

from __future__ import annotations

import copy
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bosdyn.api import power_pb2, robot_command_pb2, robot_state_pb2
from bosdyn.client.exceptions import Error as SdkError
from bosdyn.client.frame_helpers import get_a_tform_b
from bosdyn.client.robot import Robot as SdkRobot
from typer.testing import CliRunner

from benchmarks import conformance_errors
from fake_robot.conformance import paths
from fake_robot.conformance import server as server_module
from fake_robot.conformance import session as session_module
from fake_robot.conformance.check import Basis, CheckOutcome, ConformanceCheck, Needs, Result
from fake_robot.conformance.command import (
    CHECKS,
    UnreachableError,
    connect,
    exit_code,
    markdown,
    run_checks,
    run_suite,
    summary,
)
from fake_robot.conformance.power import has_power, held, is_off
from fake_robot.conformance.recording import RecordedPart, Recorder
from fake_robot.conformance.server import RPC_TIMEOUT_S, Server
from fake_robot.conformance.session import EXPIRED, HOLDING, MotionRecord, drive
from fake_robot.network.streams import StateSubscription, spoil
from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import scenario_from_data
from fake_robot.services.auth import Credentials
from fake_robot.start.commands import app
from fake_robot.start.server import FakeServer
from proof.planted.errors import ERRORS
from proof.planted.planting import STATE, STREAM, PlantedError
from proof.planted.server import RIGHT, PlantedServer
from spot_model.errors import BadInputError
from spot_model.robot.facts import STAND_KD_NM_S_PER_RAD, STAND_KP_NM_PER_RAD

BRISK: dict[str, Any] = {
    "power": {"power_on_s": 0.2, "power_off_s": 0.1},
    "motion": {"stand_s": 0.8, "sit_s": 0.8},
    "joint_control": {"activation_wait_s": 0.2},
    "services": {"cameras": "test_card"},
    "real_time": {"max_catch_up_s": 10.0},
}
"""Quick to its feet; its clock waits for no busy computer."""

OTHER_SWITCHES: dict[str, Any] = BRISK | {
    "services": {
        "clock_identifier_check": "timed_commands",
        "missing_end_time_refusal": "invalid_request",
        "second_command_stream": "evict",
        "missing_license_refusal": "invalid_request",
        "cameras": "test_card",
    },
    "joint_control": {"activation_wait_s": 0.2, "max_end_time_ahead_s": 1.0, "on_command_expiry": "freeze_torque"},
}
BIASED: dict[str, Any] = BRISK | {
    "payload": {"mass_kg": 12, "com_in_body_m": [0.05, 0.03, 0.12]},
    "sensors": {"velocity_rad_s": 0.1, "load_nm": 2.0, "body_velocity_m_s": 0.05, "attitude_rad": 0.005},
    "clock": {"skew_s": 86400.0, "drift_ppm": 60.0},
}
"""A right robot with a payload, noisy sensors and another clock."""
WITH_ARM: dict[str, Any] = BRISK | {"model": {"robot": "spot_with_arm"}}

PROGRAM = [str(Path(sys.executable).with_name("spot-rl")), "fake-robot", "conformance"]
LOGIN = {"BOSDYN_CLIENT_USERNAME": "user", "BOSDYN_CLIENT_PASSWORD": "horse"}

Start = Callable[..., tuple[Server, PlantedServer]]


IN_REAL_TIME = pytest.mark.skipif(
    "SPOT_RL_WEEKLY" not in os.environ, reason="moves a robot in real time: CI runs it once a week, with SPOT_RL_WEEKLY"
)


@contextmanager
def serving(keys: dict[str, Any], certificates: Any) -> Iterator[tuple[Server, PlantedServer]]:
    """A fake of a scenario in this process, and a planted server before it, logged in."""
    scenario = scenario_from_data(keys)
    fake = FakeServer(Robot(scenario), scenario.services, Credentials("user", "horse"), certificates)
    try:
        with PlantedServer(fake.start().robot, certificates) as planted:
            yield log_in(planted, certificates), planted
    finally:
        fake.stop()


@pytest.fixture
def start(certificates: Any) -> Iterator[Start]:
    """Start fakes, which end with the test: one that goes on takes a quarter of a processor from the others."""
    with ExitStack() as stack:
        yield lambda keys: stack.enter_context(serving(keys, certificates))


def log_in(planted: PlantedServer, certificates: Any) -> Server:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BOSDYN_CLIENT_USERNAME", "user")
        patch.setenv("BOSDYN_CLIENT_PASSWORD", "horse")
        return connect(planted.address, certificates.ca_path)


@pytest.fixture(scope="module")
def planted(certificates: Any) -> Iterator[PlantedServer]:
    """One fake for all errors that show at rest."""
    with serving(BRISK, certificates) as (_, server):
        yield server


@pytest.fixture(scope="module")
def driven(certificates: Any) -> MotionRecord:
    """The one motion of the suite, by a right robot."""
    with serving(BRISK, certificates) as (server, _):
        return drive(server)


def wrong(results: list[Result]) -> list[str]:
    return [f"{r.check.name}: {r.seen}" for r in results if r.verdict not in {CheckOutcome.PASS, CheckOutcome.SKIPPED}]


def checks(*names: str) -> list[ConformanceCheck]:
    found = {item.name: item for item in CHECKS}
    return [found[name] for name in names]


# ---- right robots ----


@IN_REAL_TIME
@pytest.mark.parametrize(
    "keys", [BRISK, OTHER_SWITCHES, BIASED, WITH_ARM], ids=["default", "other switches", "biased", "with an arm"]
)
def test_a_right_robot_conforms(start: Start, keys: dict[str, Any]) -> None:
    results = list(run_checks(start(keys)[0], Needs.MOTION))
    assert wrong(results) == []
    skipped = {"power_while_stopped"} | ({"arm_command"} if keys is WITH_ARM else set())
    assert {r.check.name for r in results if r.verdict is CheckOutcome.SKIPPED} == skipped
    assert exit_code(results) == 0


def test_a_robot_with_an_arm_conforms_at_rest(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    """By states of nineteen joints; one that is polled with a manipulator and streams twelve does not."""
    names = ("stream_is_complete", "polled_state_is_complete", "stream_expired", "stream_of_eleven_loads")
    server, _ = start(WITH_ARM)
    assert {r.verdict for r in run_checks(server, Needs.LEASE, names)} == {CheckOutcome.PASS}
    take = StateSubscription.get
    monkeypatch.setattr(StateSubscription, "get", lambda own, wait_s: spoil(take(own, wait_s) or b"", "no_arm"))
    server, _ = start(WITH_ARM)
    told = {r.check.name: r.seen for r in run_checks(server, Needs.LEASE, names[:2])}
    assert told == {"stream_is_complete": "complete", "polled_state_is_complete": "missing: 19 streamed joints"}


# ---- nobody gets power ----


def test_a_suite_without_motion_sends_nothing_that_could_give_power(start: Start) -> None:
    """Not to a robot that grants everything either, nor to one whose motors it reports as off while it stands."""
    server, planted = start(BRISK)
    list(run_checks(server, Needs.LEASE))
    assert not {"PowerService/PowerCommand", "PowerService/PowerCommandFeedback"} & {key for key, _ in planted.asked}


def test_a_robot_that_hides_its_power_loses_it_before_anything_is_sent_that_could_move_it(
    start: Start, certificates: Any
) -> None:
    server, planted = start(BRISK)
    with held(server) as lease:
        session_module._Driver(server, lease, Recorder(server), MotionRecord()).power_on()
    planted.plant(ERRORS["motor_state_always_off"])
    names = ("power_is_as_told", "stand_without_power", "stream_while_inactive")
    results = list(run_checks(log_in(planted, certificates), Needs.LEASE, names))
    assert [r.verdict for r in results] == [CheckOutcome.FAIL, CheckOutcome.PASS, CheckOutcome.PASS], results
    commands = [request.command for key, request in planted.asked if key == "RobotCommandService/RobotCommand"]
    sent = [command.full_body_command.WhichOneof("command") for command in commands]
    taken = sent.index("safe_power_off_request")
    assert set(sent[:taken]) == {"stop_request"}
    planted.plant(RIGHT)
    assert is_off(server.state())


@pytest.mark.parametrize(
    "name",
    ["motor_state_always_on", "commands_without_power", "stops_without_power", "header_without_times"],
)
def test_one_error_leaves_the_other_checks_their_way(
    planted: PlantedServer, certificates: Any, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """What a check needs, it gets from a second witness."""
    monkeypatch.setattr("fake_robot.conformance.power.CONTROLLED_OFF_S", 1.0)
    planted.plant(ERRORS[name])
    results = list(run_checks(log_in(planted, certificates), Needs.LEASE))
    assert [f"{r.check.name}: {r.seen}" for r in results if r.verdict is CheckOutcome.OPEN] == []
    assert CheckOutcome.FAIL in {r.verdict for r in results}


def test_a_robot_whose_two_witnesses_say_that_it_has_power_is_left_alone(start: Start) -> None:
    server, planted = start(BRISK)
    with held(server) as lease:
        session_module._Driver(server, lease, Recorder(server), MotionRecord()).power_on()
    (result,) = run_checks(server, Needs.LEASE, ("stand_without_power",))
    assert (result.verdict, has_power(server.state())) == (CheckOutcome.OPEN, True)
    assert "the motors are not off" in result.seen
    assert all(
        request.command.full_body_command.HasField("stop_request")
        for key, request in planted.asked
        if key[-13:] == "/RobotCommand"
    )


def test_power_that_nobody_asked_for_is_taken_away_and_told(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fake_robot.conformance.power.CONTROLLED_OFF_S", 1.0)
    server, planted = start(BRISK)
    planted.plant(ERRORS["power_for_anybody"])
    results = list(run_checks(server, Needs.MOTION, ("power_without_lease", "feet_stand_in_motion")))
    assert [r.verdict for r in results[:2]] == [CheckOutcome.FAIL, CheckOutcome.OPEN]
    assert "the motors got power: its motors were switched off" in results[0].seen
    assert exit_code(results) == 4
    assert "Motors had power that they should not have had" in summary(results)
    assert not has_power(server.state())
    last = [request.request for key, request in planted.asked if key == "PowerService/PowerCommand"][-1]
    assert last == power_pb2.PowerCommandRequest.REQUEST_OFF_MOTORS


def test_a_power_command_that_was_never_given_is_no_success(planted: PlantedServer, certificates: Any) -> None:
    planted.plant(ERRORS["power_feedback_of_nothing_succeeds"])
    (result,) = run_checks(log_in(planted, certificates), Needs.MOTION, ("power_feedback_of_nothing",))
    assert (result.verdict, result.seen) == (CheckOutcome.FAIL, "STATUS_SUCCESS")


@IN_REAL_TIME
@pytest.mark.slow
def test_a_suite_that_is_ended_in_its_motion_powers_the_robot_off_first(start: Start, certificates: Any) -> None:
    server, planted = start(BRISK)
    rest = ["--ca-file", str(certificates.ca_path), "--with-motion", "--check", "feet_stand_in_motion"]
    with subprocess.Popen([*PROGRAM, "--robot", planted.address, *rest], env={**os.environ, **LOGIN}) as process:
        while not any(key == "RobotCommandService/RobotCommandFeedback" for key, _ in planted.asked):
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
    assert process.returncode == 128 + signal.SIGTERM
    assert is_off(server.state())


def test_the_exit_code_says_whether_all_was_judged() -> None:
    item = CHECKS[0]
    passed, skipped = Result(item, CheckOutcome.PASS, "yes"), Result(item, CheckOutcome.SKIPPED, "needs --with-motion")
    is_open, failed = Result(item, CheckOutcome.OPEN, "the motors are on"), Result(item, CheckOutcome.FAIL, "no")
    assert [exit_code([passed, skipped, *more]) for more in ([], [is_open], [is_open, failed])] == [0, 3, 1]
    assert "1 not judged: needs --with-motion." in summary([passed, skipped])
    assert "is not known" in summary([passed, is_open])
    assert "does not conform" in summary([failed])


# ---- wrong robots ----


AT_REST = {
    "motor_state_always_on": "power_is_as_told",
    "stops_without_power": "power_is_as_told",
    "battery_current_negated": "units_are_plausible",
    "battery_in_kelvin": "units_are_plausible",
    "estop_response_unchecked": "estop_wrong_response",
    "estop_always_pressed": "estop_is_the_most_restrictive",
    "packets_come_60_ms_late": "stamps_are_robot_time",
    "packets_duplicated": "stamps_rise",
    "leases_are_never_returned": "returned_lease",
    "packet_stamps_in_another_clock": "stamps_are_robot_time",
    "contacts_inverted_in_stream": "stream_agrees_with_poll",
    "contacts_inverted_in_poll": "stream_agrees_with_poll",
    "estop_challenge_unchecked": "estop_wrong_response",
    "headers_not_echoed": "header_is_echoed",
    "any_password_will_do": "wrong_password",
    "no_token_needed": "token_is_asked_for_as_listed",
    "robot_without_serial": "robot_id_stays",
    "directory_lacks_joint_control": "services_are_listed",
    "directory_of_a_wrong_type": "services_are_listed",
    "directory_without_authority": "services_are_listed",
    "directory_finds_anything": "unknown_service",
    "licence_of_another_robot": "licence_is_this_robots",
    "licence_is_silent": "licence_is_this_robots",
    "header_without_times": "header_times_are_the_robots",
    "header_without_code": "reads_succeed",
    "header_times_reversed": "header_times_are_the_robots",
    "clock_skew_negated": "estimate_is_the_clocks",
    "clock_skew_in_microseconds": "estimate_is_the_clocks",
    "clock_identifier_changes": "time_sync_is_reached",
    "time_sync_never_ends": "time_sync_is_reached",
    "round_trip_negative": "estimate_is_the_clocks",
    "positions_in_degrees": "stream_agrees_with_poll",
    "left_and_right_exchanged": "feet_are_where_the_joints_put_them",
    "joint_missing": "polled_state_is_complete",
    "no_odom_frame": "polled_state_is_complete",
    "quaternion_scalar_last_as_first": "stream_agrees_with_poll",
    "quaternion_not_of_length_one": "stream_is_complete",
    "odom_edge_inverted": "stream_agrees_with_poll",
    "kinematic_stamp_frozen": "stamps_rise",
    "kinematic_stamp_in_another_clock": "stamps_are_robot_time",
    "feet_reversed": "feet_are_where_the_joints_put_them",
    "feet_mirrored_upwards": "feet_are_where_the_joints_put_them",
    "battery_as_a_fraction": "units_are_plausible",
    "battery_in_millivolts": "units_are_plausible",
    "estop_not_in_the_state": "polled_state_is_complete",
    "always_standing": "power_and_behavior_agree",
    "stream_at_half_rate": "stream_period",
    "stream_by_joint_kind": "stream_agrees_with_poll",
    "acceleration_without_gravity": "imu_feels_gravity",
    "acceleration_upside_down": "imu_feels_gravity",
    "acceleration_in_g": "imu_feels_gravity",
    "one_packet_of_three": "stream_period",
    "states_sent_twice": "stamps_rise",
    "states_out_of_order": "stamps_rise",
    "lease_for_everybody": "acquire_twice",
    "lost_lease_retained": "returned_lease",
    "owners_not_listed": "owner_is_listed",
    "lease_sequence_stands_still": "new_lease_is_newer",
    "lease_of_a_banana": "acquire_unknown_resource",
    "any_lease_can_be_returned": "return_old_lease",
    "lease_result_missing": "retain_wrong_epoch",
    "estop_of_a_stranger": "estop_unknown_endpoint",
    "estop_endpoints_not_listed": "estop_endpoints_agree",
    "estop_configuration_unchecked": "estop_register_elsewhere",
    "commands_after_their_end": "expired_command",
    "commands_of_next_year": "distant_command",
    "commands_without_power": "power_is_as_told",
    "commands_in_any_frame": "unknown_frame",
    "commands_of_nonsense": "empty_command",
    "commands_of_another_clock": "timed_without_clock",
    "commands_without_a_lease": "command_without_lease",
    "clears_faults_that_are_not": "clear_no_fault",
    "joint_stream_always_ok": "stream_while_inactive",
    "joint_stream_without_words": "stream_expired",
    "service_faults_not_shown": "service_fault_is_kept",
    "service_faults_stay": "service_fault_is_kept",
    "service_faults_without_a_time": "service_fault_is_kept",
}
"""Errors that show at rest, each with one of the checks that find it."""
IN_MOTION = {
    "body_velocity_negated": "body_velocity_is_the_slope_in_motion",
    "body_velocity_in_body": "body_velocity_is_the_slope_in_motion",
    "yaw_rate_negated": "body_velocity_is_the_slope_in_motion",
    "motor_state_always_off": "power_and_behavior_agree_in_motion",
    "motors_stay_on": "power_and_behavior_agree_in_motion",
    "load_negated_in_poll": "loads_carry_the_weight_in_motion",
    "load_negated_in_stream": "loads_carry_the_weight_in_motion",
    "contacts_inverted_in_stream": "feet_stand_in_motion",
    "gyro_in_degrees": "imu_turns_with_the_body_in_motion",
    "joints_frozen": "joint_velocity_is_the_slope_in_motion",
    "command_key_not_echoed": "servo_law",
    "acceleration_in_odom": "imu_feels_gravity_in_motion",
    "acceleration_negated_sideways": "imu_feels_gravity_in_motion",
    "gyro_in_odom": "imu_turns_with_the_body_in_motion",
    "packets_60_ms_old": "contents_are_of_their_stamps_in_motion",
    "polls_80_ms_old": "contents_are_of_their_stamps_in_motion",
    "contact_stuck": "feet_step_in_motion",
    "contacts_exchanged": "feet_step_in_motion",
    "loads_halved": "loads_carry_the_weight_in_motion",
    "joint_velocities_scaled": "joint_velocity_is_the_slope_in_motion",
    "body_velocities_scaled": "body_velocity_is_the_slope_in_motion",
    "quaternions_conjugated": "leans_as_it_is_told_in_motion",
    "feet_in_a_level_frame": "feet_are_where_the_joints_put_them_in_motion",
    "clock_two_percent_fast": "clock_runs_true_in_motion",
}
"""The same of a robot that moves, by a right robot's recording in which the messages are changed."""


def test_every_error_is_one_of_those_that_are_found_or_is_known_to_stay_hidden() -> None:
    hidden = {"estop_in_the_state_never_stopped", "estop_always_released"}  # no check presses a stop
    hidden |= {"joints_one_state_late"}  # 3 ms, as estimators have
    hidden |= {"packets_repeated_under_new_stamps", "receipt_in_another_clock"}
    elsewhere = {"power_for_anybody", "power_feedback_of_nothing_succeeds"}
    assert set(AT_REST) | set(IN_MOTION) | set(LIVE) | elsewhere == set(ERRORS) - hidden


@pytest.mark.parametrize("name", AT_REST)
def test_an_error_that_shows_at_rest_is_found(planted: PlantedServer, certificates: Any, name: str) -> None:
    planted.plant(RIGHT)
    server, before = log_in(planted, certificates), log_in(planted, certificates)
    before.ask("lease", "ReturnLease", lease=before.ask("lease", "TakeLease", resource="body").lease)  # if one was lost
    planted.plant(ERRORS[name])
    (result,) = run_checks(server, Needs.LEASE, (AT_REST[name],))
    assert result.verdict in {CheckOutcome.FAIL, CheckOutcome.DIFFERS}, result.seen


def changed(session: MotionRecord, error: PlantedError) -> MotionRecord:
    """A motion as a server with the error would have reported it."""
    pieces = {}
    memories: dict[str, dict[str, Any]] = {STREAM: {}, STATE: {}}  # a server remembers what it told before
    for part, right in session.pieces.items():
        states = [copy.deepcopy(state) for state in right.states]
        polls = [robot_state_pb2.RobotStateResponse(robot_state=poll) for poll in right.polls]
        for key, messages in ((STREAM, states), (STATE, polls)):
            if key in error.answers:
                for message in messages:
                    error.answers[key](None, message, memories[key])
        answers = [answer.robot_state for answer in polls]
        pieces[part] = RecordedPart(part, states, answers, right.arrived_ns, right.polled_ns)
    return replace(session, pieces=pieces)


@IN_REAL_TIME
@pytest.mark.parametrize("name", IN_MOTION)
def test_an_error_that_shows_in_motion_is_found(driven: MotionRecord, name: str) -> None:
    server: Any = Server(SimpleNamespace(service_client_factories_by_type={}), None)
    (item,) = checks(IN_MOTION[name])
    server._kept[drive] = driven
    assert item.probe(server) in item.expects
    server._kept[drive] = changed(driven, ERRORS[name])
    assert item.probe(server) not in item.expects


LIVE = {
    "velocity_command_never_ends": "velocity_times_out",
    "command_ids_alike": "commands_have_numbers",
    "walks_to_the_other_side": "walks_where_it_is_told_in_motion",
    "stands_at_once": "stands_when_it_says_so_in_motion",
    "never_stands": "stand_ends",
    "load_setpoint_negated": "servo_law",
    "gains_halved": "servo_law",
    "gains_six_tenths": "servo_law",
    "no_damping": "servo_law",
    "stiffness_of_one_joint": "servo_law",
    "velocity_setpoints_ignored": "servo_law",
    "load_setpoints_halved": "servo_law",
    "joint_commands_never_end": "stream_command_ends",
    "expired_commands_with_power": "expired_command",
    "power_never_comes": "power_comes",
}


@IN_REAL_TIME
@pytest.mark.slow
@pytest.mark.parametrize(
    "names",
    [
        ("velocity_command_never_ends", "walks_to_the_other_side"),
        ("command_ids_alike", "stands_at_once"),
        ("never_stands",),
        ("power_never_comes", "joint_commands_never_end", "expired_commands_with_power", "no_damping"),
    ],
    ids=" ".join,
)
def test_errors_of_commands_are_found(start: Start, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...]) -> None:
    """Errors of different calls are planted at once."""
    server, planted = start(BRISK | {"motion": {"stand_s": 2.5, "sit_s": 0.8}})
    if {"never_stands", "power_never_comes"} & set(names):
        monkeypatch.setattr(session_module, "STEP_TIMEOUT_S", 4.0)
    both = PlantedError("both", "", "own", needs_motion=True)
    for error in (ERRORS[name] for name in names):
        for mine, theirs in ((both.asks, error.asks), (both.answers, error.answers)):
            for key, hook in theirs.items():
                earlier = mine.get(key, lambda *_: None)
                mine[key] = lambda *a, one=earlier, two=hook: (one(*a), two(*a))[1]
    planted.plant(both)
    results = list(run_checks(server, Needs.MOTION, tuple(LIVE[name] for name in names)))
    assert {r.check.name for r in results if r.verdict is CheckOutcome.FAIL} == {LIVE[name] for name in names}
    assert not has_power(server.state())


def held_by(kp: float, kd: float, load: float) -> Server:
    """A motion in which the servos have these shares of the gains that were asked for, by the law and without noise."""
    session, rng = MotionRecord(), np.random.default_rng(0)
    at_rad = np.tile([0.1, 0.8, -1.5], 4)
    states = []
    for key in range(1, 161):
        session.asked[key] = asked = session_module._stepped(at_rad, key)
        for _ in range(7):
            position_rad, velocity_rad_s = at_rad + rng.normal(0, 2e-3, 12), rng.normal(0, 0.1, 12)
            measured_nm = kp * STAND_KP_NM_PER_RAD * (asked[0] - position_rad) + load * asked[2]
            measured_nm += kd * STAND_KD_NM_S_PER_RAD * (asked[1] - velocity_rad_s)
            state = robot_state_pb2.RobotStateStreamResponse(contact_states=[1] * 4)
            state.joint_states.position.extend(position_rad)
            state.joint_states.velocity.extend(velocity_rad_s)
            state.joint_states.load.extend(measured_nm)
            state.last_command.user_command_key = key
            for pose in (state.kinematic_state.odom_tform_body, state.kinematic_state.vision_tform_body):
                pose.rotation.w = 1.0
            states.append(state)
    session.pieces = {
        HOLDING: RecordedPart(HOLDING, states, [], [], []),
        EXPIRED: RecordedPart(EXPIRED, states[-7:], [], [], []),
    }
    server: Any = Server(SimpleNamespace(service_client_factories_by_type={}), None)
    server._kept[drive] = session
    return server


@pytest.mark.parametrize(
    ("shares", "seen"),
    [
        ((1.0, 1.0, 1.0), "the servo law, and the command's key"),
        ((0.6, 1.0, 1.0), "fl.hx: 0.60 of the stiffness"),
        ((1.0, 0.1, 1.0), "fl.hx: 0.10 of the damping"),
        ((1.0, 1.0, 0.5), "fl.hx: 0.50 of the load"),
    ],
)
def test_small_steps_tell_the_gains(shares: tuple[float, float, float], seen: str) -> None:
    (item,) = checks("servo_law")
    assert item.probe(held_by(*shares)) == seen


def test_a_command_that_is_followed_past_its_end_is_found() -> None:
    (item,) = checks("stream_command_ends")
    assert item.probe(held_by(1.0, 1.0, 1.0)) == "still followed"
    assert item.probe(held_by(0.0, 0.0, 0.0)) == "no longer followed"


def test_steps_ask_for_less_than_motors_have_and_for_each_part_apart() -> None:
    asked = np.array([session_module._stepped(np.zeros(12), key) for key in range(40)])
    of_nm = asked * np.array([STAND_KP_NM_PER_RAD, STAND_KD_NM_S_PER_RAD, np.ones(12)])
    steps_nm = of_nm - of_nm.mean(axis=0)
    assert np.abs(steps_nm.sum(axis=1)).max() == pytest.approx(16.0)
    assert np.einsum("kpj,kqj->pq", steps_nm, steps_nm) / 480 == pytest.approx(np.diag([49.0, 25.0, 16.0]))


@pytest.mark.parametrize("late_s", [-0.06, 0.0, 0.04])
def test_the_age_of_a_report_is_told_by_its_content(late_s: float) -> None:
    stamps_s = np.arange(0.0, 3.0, 3e-3)
    motion = lambda t: np.stack([np.sin(9.0 * t), np.cos(13.0 * t)], axis=1)  # noqa: E731
    seen = motion(stamps_s - late_s) + np.random.default_rng(0).normal(0.0, 0.3, (len(stamps_s), 2))
    assert paths.late_s(stamps_s, seen, stamps_s, motion(stamps_s)) == pytest.approx(late_s, abs=0.004)


# ---- what is no error ----


def test_what_a_server_does_not_offer_is_skipped(planted: PlantedServer, certificates: Any) -> None:
    absent = {"world-objects", "image", "directory-registration"}

    def lack(_request: Any, answer: Any, _memory: Any) -> None:
        kept = [entry for entry in answer.service_entries if entry.name not in absent]
        del answer.service_entries[:]
        answer.service_entries.extend(kept)

    planted.plant(
        PlantedError("lack", "", "own", needs_motion=False, answers={"DirectoryService/ListServiceEntries": lack})
    )
    names = ("unknown_camera", "images_are_as_told", "delete_unknown_object", "registration_is_kept")
    results = run_checks(log_in(planted, certificates), Needs.LEASE, (*names, "services_are_listed"))
    assert {r.check.name: r.verdict for r in results} == {
        "services_are_listed": CheckOutcome.FAIL,
        **dict.fromkeys(names, CheckOutcome.SKIPPED),
    }


def answered(planted: PlantedServer, certificates: Any, key: str, change: Callable[[Any], object]) -> Server:
    """A server whose answers to a method are changed."""
    hook = lambda _request, answer, _memory: (change(answer), None)[1]  # noqa: E731
    planted.plant(PlantedError("", "", "own", needs_motion=False, answers={key: hook}))
    return log_in(planted, certificates)


def test_polled_joints_may_come_in_any_order_and_a_battery_bay_may_be_empty(
    planted: PlantedServer, certificates: Any
) -> None:
    def change(response: Any) -> None:
        state = response.robot_state
        joints = list(state.kinematic_state.joint_states)[::-1]
        del state.kinematic_state.joint_states[:]
        state.kinematic_state.joint_states.extend(joints)
        state.battery_states.insert(0, robot_state_pb2.BatteryState(status=robot_state_pb2.BatteryState.STATUS_MISSING))

    names = ("polled_state_is_complete", "stream_agrees_with_poll", "units_are_plausible", "stamps_are_robot_time")
    results = run_checks(answered(planted, certificates, STATE, change), Needs.LEASE, names)
    results = list(results)
    assert {r.check.name: r.verdict for r in results} == dict.fromkeys(names, CheckOutcome.PASS), wrong(results)


@pytest.mark.parametrize("looks_at_clocks", [False, True])
def test_a_server_may_look_at_the_power_before_end_times_and_frames(
    planted: PlantedServer, certificates: Any, looks_at_clocks: bool
) -> None:
    """The protos name no order of what is looked at."""
    kinds = robot_command_pb2.RobotCommandResponse

    def power_first(response: Any) -> None:
        if not (looks_at_clocks and response.status == kinds.STATUS_NO_TIMESYNC):
            response.status = kinds.STATUS_NOT_POWERED_ON

    names = ("unknown_frame", "expired_command", "timed_without_clock", "stand_without_power")
    server = answered(planted, certificates, "RobotCommandService/RobotCommand", power_first)
    assert {r.check.name: r.verdict for r in run_checks(server, Needs.LEASE, names)} == {
        "unknown_frame": CheckOutcome.SKIPPED,
        "expired_command": CheckOutcome.SKIPPED,
        "timed_without_clock": CheckOutcome.PASS if looks_at_clocks else CheckOutcome.SKIPPED,
        "stand_without_power": CheckOutcome.PASS,
    }


def test_a_tree_of_frames_may_have_any_root(planted: PlantedServer, certificates: Any) -> None:
    """Odom at the root, and the body and vision below it."""

    def replant(response: Any) -> None:
        snapshot = response.robot_state.kinematic_state.transforms_snapshot
        edges = snapshot.child_to_parent_edge_map
        poses = {name: get_a_tform_b(snapshot, "odom", name) for name in ("body", "vision")}
        for name, pose in poses.items():
            edges[name].parent_frame_name = "odom"
            edges[name].parent_tform_child.CopyFrom(pose.to_proto())
        edges["odom"].Clear()

    server = answered(planted, certificates, STATE, replant)
    (result,) = run_checks(server, Needs.LEASE, ("stream_agrees_with_poll",))
    assert result.verdict is CheckOutcome.PASS, result.seen


def test_answers_that_cannot_be_read_leave_the_check_open(planted: PlantedServer, certificates: Any) -> None:
    def no_epoch(answer: Any) -> None:
        del answer.lease.sequence[:]

    server = answered(planted, certificates, "LeaseService/AcquireLease", no_epoch)
    (result,) = run_checks(server, Needs.LEASE, ("older_lease",))
    assert (result.verdict, exit_code([result])) == (CheckOutcome.OPEN, 3)
    assert "cannot be read: IndexError" in result.seen


def test_a_call_that_is_not_answered_in_time_leaves_the_check_open(
    planted: PlantedServer, certificates: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted.plant(RIGHT)
    server = log_in(planted, certificates)
    server.require("directory")
    monkeypatch.setattr(server_module, "RPC_TIMEOUT_S", -1.0)
    (result,) = run_checks(server, Needs.LEASE, ("unknown_service",))
    assert (result.verdict, result.seen) == (CheckOutcome.OPEN, "no answer: DEADLINE_EXCEEDED")


# ---- the table, the command ----


def test_names_are_one_each_and_every_switch_is_a_key_of_the_scenario() -> None:
    names = [item.name for item in CHECKS]
    assert len(names) == len(set(names))
    for part, key in (item.switch.split(".") for item in CHECKS if item.switch):
        assert key in scenario_from_data({}).to_data()[part]
    assert all(len(item.expects) == 1 or "no status" in item.sends for item in CHECKS if item.basis is not Basis.GUESS)


def test_every_status_of_a_robot_command_that_needs_no_accident_is_checked() -> None:
    """Frozen, docked and behaviour faults need an accident or a dock."""
    names = robot_command_pb2.RobotCommandResponse.Status.keys()
    seen = {answer for item in CHECKS for answer in item.expects}
    assert set(names) - seen == {"STATUS_UNKNOWN", "STATUS_BEHAVIOR_FAULT", "STATUS_DOCKED"}


def test_a_host_that_may_be_a_robot_needs_somebody_beside_it() -> None:
    keywords: dict[str, Any] = {"with_motion": False, "ca_file": None, "names": (), "as_json": True}
    with pytest.raises(BadInputError, match="--i-stand-beside-it"):
        run_suite("192.168.80.3", is_attended=False, **keywords)
    with pytest.raises(BadInputError, match="BOSDYN_CLIENT_USERNAME"):
        run_suite("127.0.0.1", is_attended=False, **keywords)


def test_a_server_that_never_answers_is_not_waited_for_for_ever(
    certificates: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The SDK's own default is no deadline at all."""
    given: list[float | None] = []

    def told(*_: Any, timeout: float | None = None) -> None:
        given.append(timeout)
        raise SdkError("nobody answers")

    monkeypatch.setattr(SdkRobot, "authenticate", told)
    monkeypatch.setenv("BOSDYN_CLIENT_USERNAME", "user")
    monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", "horse")
    with pytest.raises(UnreachableError, match="nobody answers"):
        connect("127.0.0.1:1", certificates.ca_path)
    assert given == [RPC_TIMEOUT_S]


def test_the_command_prints_json_and_fails_for_a_broken_rule(
    planted: PlantedServer, certificates: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted.plant(RIGHT)
    monkeypatch.setenv("BOSDYN_CLIENT_USERNAME", "user")
    monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", "horse")
    rest = ["--ca-file", str(certificates.ca_path), "--check", "unknown_service"]
    host = planted.address
    words = ["conformance", "--robot", host, *rest]
    told = CliRunner().invoke(app, [*words, "--json"])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)[0]["seen"] == "STATUS_NONEXISTENT_SERVICE"
    planted.plant(ERRORS["directory_finds_anything"])
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 1
    assert "expected STATUS_NONEXISTENT_SERVICE" in told.stdout
    assert "The server does not conform." in told.stdout
    told = CliRunner().invoke(app, [*words[:-1], "no_such_check"])
    assert "there is no check no_such_check" in str(told.exception)
    told = CliRunner().invoke(app, ["conformance", "--robot", "127.0.0.1:1", *rest])
    assert "127.0.0.1:1: " in str(told.exception)
    assert "check the address, the login, and --ca-file" in str(told.exception)


def test_the_command_runs_in_a_process_of_its_own(start: Start, certificates: Any) -> None:
    """The fake's own modules, which this process has loaded, are not there; nobody else holds the robot's lease."""
    _, planted = start(BRISK)
    planted.plant(RIGHT)
    done = subprocess.run(
        [*PROGRAM, "--robot", planted.address, "--ca-file", str(certificates.ca_path)],
        env={**os.environ, **LOGIN},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "No rule is broken in what was judged."


def test_the_count_of_planted_errors_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BOSDYN_CLIENT_USERNAME", "")  # put back afterwards
    monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", "")
    conformance_errors.main(["robot_without_serial"])
    assert "'own': '1 of 1'" in capsys.readouterr().out


def test_the_table_stands_in_the_documentation() -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "conformance.md"
    assert markdown() in page.read_text(encoding="utf-8"), "run: make docs"
