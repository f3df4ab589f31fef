"""The conformance suite: our fake passes it, whatever its switches say, and a server with planted errors does not."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bosdyn.api import lease_pb2, robot_command_pb2, robot_state_pb2, time_sync_pb2
from bosdyn.api.local_grid_pb2 import LocalGrid
from bosdyn.client.exceptions import Error as SdkError
from bosdyn.client.frame_helpers import get_a_tform_b
from bosdyn.client.robot import Robot as SdkRobot
from bosdyn.client.sdk import create_standard_sdk
from typer.testing import CliRunner

from fake_robot.conformance.check import Basis, Needs, Verdict
from fake_robot.conformance.command import UnreachableError, connect, run_suite
from fake_robot.conformance.server import RPC_TIMEOUT_S, Server, SkippedError, powered
from fake_robot.conformance.table import CHECKS, markdown, run_checks
from fake_robot.eyes.eyes import Eyes
from fake_robot.robot import state_message, streamed_command
from fake_robot.robot.joint_control import JointControl
from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import scenario_from_data
from fake_robot.services import stubs
from fake_robot.services.authority.estop import EstopService
from fake_robot.services.authority.estop_endpoints import EstopEndpoints
from fake_robot.services.authority.lease import LeaseService
from fake_robot.services.authority.lease_records import LeaseRecords
from fake_robot.services.calls import access
from fake_robot.services.identity import directory_entries, time_sync_clients
from fake_robot.services.identity.directory import DirectoryService
from fake_robot.services.identity.license import LicenseService
from fake_robot.services.identity.robot_id import RobotIdService
from fake_robot.services.identity.time_sync_clients import TimeSyncClients
from fake_robot.services.identity.tokens import Credentials, LoginResult, TokenMint
from fake_robot.services.motion import robot_command
from fake_robot.services.motion.feedback import feedback
from fake_robot.services.motion.robot_command import RobotCommandService
from fake_robot.services.reports import robot_state_message
from fake_robot.services.reports.robot_state import RobotStateService
from fake_robot.services.sensors import local_grids
from fake_robot.services.sensors.cameras import ImageService
from fake_robot.services.sensors.world_objects import WorldObjectService
from fake_robot.start.commands import app
from fake_robot.start.server import FakeServer
from spot_model.errors import BadInputError

ALL_SETTINGS = [
    {},
    {
        "services": {
            "clock_identifier_check": "timed_commands",
            "missing_end_time_refusal": "invalid_request",
            "second_command_stream": "evict",
            "missing_license_refusal": "invalid_request",
        },
        "joint_control": {"activation_wait_s": 0.2, "max_end_time_ahead_s": 1.0, "on_command_expiry": "freeze_torque"},
    },
]
"""Scenarios that together set every switch of the table both ways."""

Serve = Callable[..., Server]


@pytest.fixture
def serve(certificates: Any) -> Iterator[Serve]:
    """Start a fake in this process, log in and synchronise; keywords are keys of its scenario."""
    ends: list[Callable[[], None]] = []

    def start(**keys: Any) -> Server:
        keys = {"joint_control": {"activation_wait_s": 0.2}, **keys}
        scenario = scenario_from_data(keys)
        fake = FakeServer(Robot(scenario), scenario.services, Credentials("user", "horse"), certificates)
        host = fake.start().sdk_host
        ends.append(fake.stop)
        sdk, other = (create_standard_sdk("test", cert_resource_glob=str(certificates.ca_path)) for _ in range(2))
        robot = sdk.create_robot(host)
        robot.authenticate("user", "horse")
        robot.time_sync.wait_for_sync(timeout_sec=20)
        ends.append(robot.stop_time_sync)
        return Server(robot, other.create_robot(host))

    yield start
    for end in reversed(ends):
        end()


@pytest.mark.parametrize("settings", ALL_SETTINGS)
def test_the_fake_passes_with_every_switch_either_way(
    serve: Serve, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any]
) -> None:
    if settings:  # pictures have no switch
        blind(monkeypatch)
    broken = [
        f"{r.check.name}: {r.seen}"
        for r in run_checks(serve(**settings), Needs.LEASE)
        if r.verdict in {Verdict.FAIL, Verdict.DIFFERS}
    ]
    assert not broken


def test_the_fake_walks_for_the_suite(serve: Serve) -> None:
    brisk = {"power": {"power_on_s": 0.2, "power_off_s": 0.1}, "motion": {"stand_s": 0.8, "sit_s": 0.8}}
    results = list(run_checks(serve(**brisk), Needs.MOTION, ("velocity_times_out", "trajectory_arrives")))
    assert [(r.check.name, r.seen) for r in results if r.verdict is not Verdict.PASS] == []


def _always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let cameras show their test card, which is there at once."""
    monkeypatch.setattr(Eyes, "look", _always(None))


def _good_lease(_self: Any, _lease: Any, **_: Any) -> lease_pb2.LeaseUseResult:
    return lease_pb2.LeaseUseResult(status=lease_pb2.LeaseUseResult.STATUS_OK)


def _unsorted_stamps(build: Callable[..., bytes]) -> Callable[..., bytes]:
    """Every second message bears a stamp 5 ms old."""
    count = iter(range(10**9))
    return lambda self, report, stamp_ns, *rest: build(self, report, stamp_ns - 5_000_000 * (next(count) % 2), *rest)


def _states(change: Callable[[Any], None]) -> Callable[[pytest.MonkeyPatch], None]:
    """Plant a change of every message of the state stream."""
    build = state_message.StateMessageBuilder.build

    def changed(*arguments: Any) -> bytes:
        message = robot_state_pb2.RobotStateStreamResponse.FromString(build(*arguments))
        change(message)
        return bytes(message.SerializeToString())

    return lambda m: m.setattr(state_message.StateMessageBuilder, "build", changed)


def _answers(service: Any, method: str, change: Callable[[Any], None]) -> Callable[[pytest.MonkeyPatch], None]:
    """Plant a change of every answer of a method."""
    answer = getattr(service, method)

    def changed(*arguments: Any) -> Any:
        response = answer(*arguments)
        change(response)
        return response

    return lambda m: m.setattr(service, method, changed)


def _ahead(best: Callable[..., Any]) -> Callable[..., Any]:
    """Estimates that are 50 ms off."""

    def changed(*arguments: Any) -> Any:
        sample = best(*arguments)
        return None if sample is None else replace(sample, clock_skew_ns=sample.clock_skew_ns + 50_000_000)

    return changed


def _turn(rotation: Any) -> None:
    rotation.w, rotation.x, rotation.y, rotation.z = rotation.x, rotation.y, rotation.z, rotation.w


def _set(message: Any, **values: Any) -> None:
    for name, value in values.items():
        setattr(message, name, value)


def _swap_legs(state: Any) -> None:
    position = state.joint_states.position
    position[:] = [*position[3:6], *position[:3], *position[6:]]


def _late(stamp: Any) -> None:
    stamp.seconds += 199


PLANTED: dict[str, tuple[Callable[[pytest.MonkeyPatch], None], set[str]]] = {
    "any password will do": (
        lambda m: m.setattr(TokenMint, "log_in", _always((LoginResult.OK, "token"))),
        {"wrong_password"},
    ),
    "any token will do": (lambda m: m.setattr(TokenMint, "user_of", _always("user")), {"call_without_token"}),
    "headers are not echoed": (lambda m: m.setattr(access, "fill_header", _always(None)), {"header_is_echoed"}),
    "a service is missing": (
        lambda m: m.delitem(directory_entries.LISTED_ONLY, "robot-mission"),
        {"base_services_are_listed"},
    ),
    "any clock identifier will do": (
        lambda m: m.setattr(TimeSyncClients, "is_established", _always(True)),
        {"timed_without_clock", "timed_with_unknown_clock"},
    ),
    "time sync needs no samples": (
        lambda m: m.setattr(
            time_sync_pb2.TimeSyncState, "STATUS_MORE_SAMPLES_NEEDED", time_sync_pb2.TimeSyncState.STATUS_OK
        ),
        {"first_time_sync"},
    ),
    "any lease will do": (
        lambda m: m.setattr(LeaseRecords, "use", _good_lease),
        {"empty_lease", "unmanaged_lease", "wrong_epoch", "older_lease", "power_without_lease", "lease_after_sublease"},
    ),
    "a lease can be acquired twice": (
        lambda m: m.setattr(LeaseRecords, "_live_claim", _always(None)),
        {"acquire_twice", "granted_lease"},
    ),
    "any e-stop endpoint may check in": (
        lambda m: m.setattr(EstopEndpoints, "check_in", _always((1, 1))),
        {"estop_unknown_endpoint"},
    ),
    "end times of commands are not checked": (
        lambda m: m.setattr(RobotCommandService, "_check_end_time", _always(None)),
        {"expired_command", "distant_command"},
    ),
    "commands need no power": (
        lambda m: m.setattr(RobotCommandService, "_check_state", _always(None)),
        {"stand_without_power", "joint_control_without_power"},
    ),
    "end times of joint commands are not checked": (
        lambda m: m.setattr(JointControl, "check_end_time", _always(None)),
        {"stream_expired", "stream_too_distant"},
    ),
    "joint commands of any length": (
        lambda m: m.setattr(streamed_command, "_values", lambda _name, field: _padded(field)),
        {"stream_of_eleven_positions", "stream_of_eleven_velocities", "stream_of_eleven_loads"},
    ),
    "states go back in time": (
        lambda m: m.setattr(
            state_message.StateMessageBuilder, "build", _unsorted_stamps(state_message.StateMessageBuilder.build)
        ),
        {"stream_stamps_rise"},
    ),
    "joints bear the names of a URDF": (
        lambda m: m.setattr(robot_state_message, "_vendor_joint", lambda name: name),
        {"joint_names"},
    ),
    "the stream has the right legs first": (_states(_swap_legs), {"stream_agrees_with_poll"}),
    "loads are shares of the largest": (
        _states(lambda s: s.joint_states.load.__setitem__(slice(None), [25.0] * 12)),
        {"stream_agrees_with_poll"},
    ),
    "the polled body's velocity is another's": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: _set(r.robot_state.kinematic_state.velocity_of_body_in_vision.angular, z=1.0),
        ),
        {"body_rests"},
    ),
    "the feet are listed as the joints of another robot": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: [_set(f.foot_position_rt_body, x=-f.foot_position_rt_body.x) for f in r.robot_state.foot_state],
        ),
        {"feet_are_in_order"},
    ),
    "the ground has no frame": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: r.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map.pop("gpe"),
        ),
        {"polled_state_is_complete"},
    ),
    "the streamed body's velocity is in mm/s": (
        _states(lambda s: _set(s.kinematic_state.velocity_of_body_in_odom.linear, x=2.0)),
        {"body_rests"},
    ),
    "rotations are written x, y, z, w": (
        _states(lambda s: _turn(s.kinematic_state.odom_tform_body.rotation)),
        {"stream_agrees_with_poll"},
    ),
    "rotations are not normalised": (
        _states(lambda s: _set(s.kinematic_state.vision_tform_body.rotation, w=2.0)),
        {"rotations_are_units"},
    ),
    "accelerations are in g": (
        _states(
            lambda s: [
                _set(a, x=a.x / 9.81, y=a.y / 9.81, z=a.z / 9.81)
                for a in (p.acceleration_rt_odom_in_link_frame for p in s.inertial_state.packets)
            ]
        ),
        {"imu_feels_gravity"},
    ),
    "samples of the inertial unit bear one time": (
        _states(
            lambda s: [p.timestamp.CopyFrom(s.inertial_state.packets[0].timestamp) for p in s.inertial_state.packets]
        ),
        {"imu_period"},
    ),
    "contacts are unknown": (
        _states(lambda s: s.contact_states.__setitem__(2, robot_state_pb2.FootState.CONTACT_UNKNOWN)),
        {"contacts_are_known", "stream_agrees_with_poll"},
    ),
    "states bear the host's time": (
        _states(lambda s: _late(s.joint_states.acquisition_timestamp)),
        {"stamps_are_robot_time"},
    ),
    "a map tells no kinematics": (
        lambda monkeypatch: monkeypatch.setattr(stubs, "fill_kinematics", _always(None)),
        {"localization_tells_kinematics"},
    ),
    "a battery's charge is a share": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: _set(r.robot_state.battery_states[0].charge_percentage, value=0.82),
        ),
        {"battery_is_plausible"},
    ),
    "the summary of the charge is a share": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: _set(r.robot_state.power_state.locomotion_charge_percentage, value=0.82),
        ),
        {"battery_is_plausible"},
    ),
    "a battery has no voltage": (
        _answers(
            RobotStateService, "GetRobotState", lambda r: _set(r.robot_state.battery_states[0].voltage, value=0.0)
        ),
        {"battery_is_plausible"},
    ),
    "a battery's voltage is in millivolts": (
        _answers(
            RobotStateService, "GetRobotState", lambda r: _set(r.robot_state.battery_states[0].voltage, value=52100.0)
        ),
        {"battery_is_plausible"},
    ),
    "e-stops have no type": (
        _answers(RobotStateService, "GetRobotState", lambda r: _set(r.robot_state.estop_states[0], type=0)),
        {"estops_are_known"},
    ),
    "batteries bear the host's time": (
        _answers(RobotStateService, "GetRobotState", lambda r: _late(r.robot_state.battery_states[0].timestamp)),
        {"stamps_are_robot_time"},
    ),
    "joints have the velocities of others": (
        _states(lambda s: s.joint_states.velocity.__setitem__(slice(None), [0.19] * 12)),
        {"velocity_is_the_slope"},
    ),
    "a joint is polled under another's name": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: _set(r.robot_state.kinematic_state.joint_states[3], name="fl.hx"),
        ),
        {"joint_names", "stream_agrees_with_poll"},
    ),
    "the e-stop's system is milder than an endpoint": (
        _answers(EstopService, "GetEstopSystemStatus", lambda r: r.status.endpoints.add(stop_level=1)),
        {"estop_is_the_most_restrictive"},
    ),
    "links bear names of their own": (
        _answers(
            RobotStateService,
            "GetRobotHardwareConfiguration",
            lambda r: _set(r.hardware_configuration.skeleton, urdf='<robot name="r"><link name="body"/></robot>'),
        ),
        {"skeleton_has_the_legs"},
    ),
    "the skeleton has no URDF": (
        _answers(
            RobotStateService,
            "GetRobotHardwareConfiguration",
            lambda r: r.hardware_configuration.skeleton.ClearField("urdf"),
        ),
        {"skeleton_has_the_legs"},
    ),
    "the skew is another's": (
        lambda m: m.setattr(TimeSyncClients, "best", _ahead(TimeSyncClients.best)),
        {"skew_is_the_clocks"},
    ),
    "the skeleton is empty": (
        _answers(
            RobotStateService,
            "GetRobotHardwareConfiguration",
            lambda r: r.hardware_configuration.skeleton.ClearField("links"),
        ),
        {"skeleton_has_the_legs"},
    ),
    "the robot's number changes": (
        _answers(RobotIdService, "GetRobotId", lambda r: _set(r.robot_id, serial_number=secrets.token_hex(4))),
        {"robot_id_stays"},
    ),
    "returned leases go on": (
        lambda m: m.setattr(LeaseRecords, "give_back", _always(1)),
        {"returned_lease"},
    ),
    "nobody owns a lease": (
        _answers(
            LeaseService, "ListLeases", lambda r: [resource.ClearField("lease_owner") for resource in r.resources]
        ),
        {"owner_is_listed"},
    ),
    "a service is of another type": (
        lambda m: m.setitem(directory_entries.OWN_SERVICES, "estop", ("bosdyn.api.Estop", "estop.spot.robot", True)),
        {"types_are_the_sdks"},
    ),
    "registered services are forgotten": (
        lambda m: m.setattr(directory_entries.DirectoryEntries, "_store", _always(None)),
        {"registration_is_kept"},
    ),
    "world objects are not listed": (
        _answers(WorldObjectService, "ListWorldObjects", lambda r: r.ClearField("world_objects")),
        {"world_object_is_kept"},
    ),
    "all clients have one clock": (
        lambda m: m.setattr(time_sync_clients.secrets, "token_hex", _always("clock")),
        {"identifiers_differ"},
    ),
    "images are smaller than their source": (
        _answers(ImageService, "GetImage", lambda r: _set(r.image_responses[0].shot.image, rows=1)),
        {"image_is_as_large_as_its_source"},
    ),
    "a report is an error": (
        _answers(RobotStateService, "GetRobotMetrics", lambda r: _set(r.header.error, code=2)),
        {"reads_succeed"},
    ),
    "no service asks for a token": (
        _answers(
            DirectoryService,
            "ListServiceEntries",
            lambda r: [_set(entry, user_token_required=False) for entry in r.service_entries],
        ),
        {"token_is_asked_for_as_listed"},
    ),
    "leases form no tree": (
        _answers(LeaseService, "ListLeases", lambda r: r.ClearField("resource_tree")),
        {"leases_form_a_tree"},
    ),
    "refused leases do not come back": (
        _answers(RobotCommandService, "ClearBehaviorFault", lambda r: r.lease_use_result.ClearField("attempted_lease")),
        {"attempted_lease_is_told"},
    ),
    "the e-stop's status has no endpoints": (
        _answers(EstopService, "GetEstopSystemStatus", lambda r: r.status.ClearField("endpoints")),
        {"estop_endpoints_agree"},
    ),
    "the e-stop's configuration has no identifier": (
        _answers(EstopService, "GetEstopConfig", lambda r: r.active_config.ClearField("unique_id")),
        {"estop_endpoints_agree"},
    ),
    "temperatures are in kelvin": (
        _answers(
            RobotStateService,
            "GetRobotState",
            lambda r: [_set(m, temperature=300.0) for m in r.robot_state.system_state.motor_temperatures],
        ),
        {"temperatures_are_in_celsius"},
    ),
    "a command that nobody sent is confirmed": (
        _states(lambda s: _set(s.last_command, user_command_key=7)),
        {"last_command_has_a_time"},
    ),
    "service faults are not reported": (
        _answers(RobotStateService, "GetRobotState", lambda r: r.robot_state.service_fault_state.ClearField("faults")),
        {"service_fault_is_reported"},
    ),
    "images have no time": (
        _answers(
            ImageService, "GetImage", lambda r: [i.shot.ClearField("acquisition_time") for i in r.image_responses]
        ),
        {"images_tell_when_and_where"},
    ),
    "cameras have no focal length": (
        _answers(
            ImageService, "GetImage", lambda r: [i.source.pinhole.ClearField("intrinsics") for i in r.image_responses]
        ),
        {"images_tell_when_and_where"},
    ),
    "grids have cells of another size": (
        lambda m: m.setitem(local_grids._FORMATS, "no_step", (LocalGrid.CELL_FORMAT_INT16, b"\0")),
        {"grids_have_their_cells"},
    ),
    "the licence has no status": (
        _answers(LicenseService, "GetLicenseInfo", lambda r: _set(r.license, status=0)),
        {"license_is_told"},
    ),
}
"""What is wrong with the server, how it is planted, and the checks that must find it."""


def _padded(field: Any) -> Any:
    import numpy as np

    return np.resize(np.array(field[:], dtype=np.float64), 12)[np.newaxis]


@pytest.mark.parametrize("error", PLANTED)
def test_a_planted_error_is_found(serve: Serve, monkeypatch: pytest.MonkeyPatch, error: str) -> None:
    plant, finders = PLANTED[error]
    blind(monkeypatch)
    # A server binds its methods when it starts; logging in is easier while login and headers are right.
    is_first = error not in {"any password will do", "headers are not echoed", "all clients have one clock"}
    if is_first:
        plant(monkeypatch)
    server = serve()
    if not is_first:
        plant(monkeypatch)
    results = {r.check.name: r for r in run_checks(server, Needs.LEASE, tuple(finders))}
    missed = {name for name in finders if results[name].verdict is not Verdict.FAIL}
    assert not missed, {name: results[name].seen for name in missed}


@pytest.mark.parametrize(
    ("change", "seen"),
    [
        (lambda _s: None, "the slopes of positions and attitude"),
        (
            lambda s: s.joint_states.velocity.__setitem__(slice(None), [-v for v in s.joint_states.velocity]),
            "fl.hx does not travel as its velocity says",
        ),
        (
            lambda s: [
                _set(p.angular_velocity_rt_odom_in_link_frame, z=57.3 * p.angular_velocity_rt_odom_in_link_frame.z)
                for p in s.inertial_state.packets
            ],
            "the body does not turn as its inertial unit says",
        ),
    ],
    ids=["none", "velocities of the other sign", "a turn rate in degrees"],
)
def test_errors_that_show_in_motion_alone_are_found_there(
    serve: Serve, monkeypatch: pytest.MonkeyPatch, change: Callable[[Any], Any], seen: str
) -> None:
    _states(change)(monkeypatch)
    brisk = {"power": {"power_on_s": 0.2, "power_off_s": 0.1}, "motion": {"stand_s": 0.8, "sit_s": 0.8}}
    results = list(run_checks(serve(**brisk), Needs.MOTION, ("rates_are_slopes",)))
    assert [result.seen for result in results] == [seen]


def test_a_robot_that_says_too_early_that_it_stands_is_found(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty(*arguments: Any, **keywords: Any) -> Any:
        told = feedback(*arguments, **keywords)
        stand = told.synchronized_feedback.mobility_command_feedback.stand_feedback
        stand.status = stand.STATUS_IS_STANDING
        return told

    monkeypatch.setattr(robot_command, "feedback", hasty)
    slow = {"power": {"power_on_s": 0.2, "power_off_s": 0.1}, "motion": {"stand_s": 3.0, "sit_s": 0.8}}
    results = list(run_checks(serve(**slow), Needs.MOTION, ("stream_agrees_while_standing",)))
    assert [(result.verdict, result.seen) for result in results] == [(Verdict.FAIL, "the robot still moves")]


def test_what_a_server_does_not_offer_is_skipped(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    for table in (directory_entries.OWN_SERVICES, directory_entries.LISTED_ONLY):
        for name in ("world-objects", "image", "directory-registration"):
            monkeypatch.delitem(table, name, raising=False)
    names = ("unknown_camera", "image_is_as_large_as_its_source", "delete_unknown_object", "registration_is_kept")
    results = list(run_checks(serve(), Needs.LEASE, (*names, "base_services_are_listed")))
    assert {r.check.name: r.verdict for r in results} == {
        "base_services_are_listed": Verdict.FAIL,
        **dict.fromkeys(names, Verdict.SKIPPED),
    }


def test_polled_joints_may_come_in_any_order_and_a_battery_bay_may_be_empty(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    def change(response: Any) -> None:
        state = response.robot_state
        joints = list(state.kinematic_state.joint_states)[::-1]
        del state.kinematic_state.joint_states[:]
        state.kinematic_state.joint_states.extend(joints)
        state.battery_states.insert(0, robot_state_pb2.BatteryState(status=robot_state_pb2.BatteryState.STATUS_MISSING))

    _answers(RobotStateService, "GetRobotState", change)(monkeypatch)
    names = ("joint_names", "stream_agrees_with_poll", "battery_is_plausible", "stamps_are_robot_time")
    results = run_checks(serve(), Needs.LEASE, names)
    assert {r.check.name: r.verdict for r in results} == dict.fromkeys(names, Verdict.PASS)


def test_a_server_that_looks_at_the_power_first_leaves_other_refusals_open(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpowered = robot_command_pb2.RobotCommandResponse.STATUS_NOT_POWERED_ON
    _answers(RobotCommandService, "RobotCommand", lambda r: _set(r, status=unpowered))(monkeypatch)
    names = ("unknown_frame", "expired_command", "timed_without_clock", "stand_without_power")
    results = run_checks(serve(), Needs.LEASE, names)
    assert {r.check.name: r.verdict for r in results} == {
        **dict.fromkeys(names, Verdict.SKIPPED),
        "stand_without_power": Verdict.PASS,
    }


def test_a_server_that_looks_at_clocks_then_power_leaves_end_times_and_frames_open(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The protos name no order of what is looked at."""
    kinds = robot_command_pb2.RobotCommandResponse

    def power_second(response: Any) -> None:
        if response.status != kinds.STATUS_NO_TIMESYNC:
            response.status = kinds.STATUS_NOT_POWERED_ON

    _answers(RobotCommandService, "RobotCommand", power_second)(monkeypatch)
    names = ("unknown_frame", "expired_command", "timed_without_clock", "timed_with_unknown_clock")
    results = run_checks(serve(), Needs.LEASE, names)
    assert {r.check.name: r.verdict for r in results} == {
        "unknown_frame": Verdict.SKIPPED,
        "expired_command": Verdict.SKIPPED,
        "timed_without_clock": Verdict.PASS,
        "timed_with_unknown_clock": Verdict.PASS,
    }


def test_a_tree_of_frames_may_have_any_root(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    """Odom at the root, and the body and vision below it."""

    def replant(response: Any) -> None:
        snapshot = response.robot_state.kinematic_state.transforms_snapshot
        edges = snapshot.child_to_parent_edge_map
        poses = {name: get_a_tform_b(snapshot, "odom", name) for name in ("body", "vision")}
        for name, pose in poses.items():
            edges[name].parent_frame_name = "odom"
            edges[name].parent_tform_child.CopyFrom(pose.to_proto())
        edges["odom"].Clear()

    _answers(RobotStateService, "GetRobotState", replant)(monkeypatch)
    (result,) = run_checks(serve(), Needs.LEASE, ("stream_agrees_with_poll",))
    assert result.verdict is Verdict.PASS, result.seen


def test_names_are_one_each_and_every_guess_with_several_answers_has_a_switch_or_is_about_order() -> None:
    names = [item.name for item in CHECKS]
    assert len(names) == len(set(names))
    for item in CHECKS:
        if item.basis is not Basis.GUESS:
            assert len(item.expects) == 1 or item.name == "docking_state", item.name
        if item.switch:
            assert _has_key(item.switch), item.switch


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
    """The SDK's own default for these three calls is no deadline at all."""
    given: list[float | None] = []

    def told(*_: Any, timeout: float | None = None) -> bool:
        given.append(timeout)
        if len(given) == 1:
            raise SdkError("nobody answers")
        return len(given) > 2

    monkeypatch.setattr(SdkRobot, "authenticate", told)
    monkeypatch.setenv("BOSDYN_CLIENT_USERNAME", "user")
    monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", "horse")
    with pytest.raises(UnreachableError, match="nobody answers"):
        connect("127.0.0.1:1", certificates.ca_path)
    robot: Any = SimpleNamespace(is_estopped=told, is_powered_on=told)
    with pytest.raises(SkippedError, match="on already"), powered(Server(robot, robot)):
        pass
    assert given == [RPC_TIMEOUT_S] * 3


def test_the_command_prints_json_and_fails_for_a_broken_rule(
    serve: Serve, certificates: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = serve()
    host = server.robot.address
    monkeypatch.setenv("BOSDYN_CLIENT_USERNAME", "user")
    monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", "horse")
    words = ["conformance", "--robot", host, "--ca-file", str(certificates.ca_path), "--check", "unknown_service"]
    told = CliRunner().invoke(app, [*words, "--json"])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)[0]["seen"] == "STATUS_NONEXISTENT_SERVICE"
    monkeypatch.setattr(directory_entries.DirectoryEntries, "entry", lambda self, _name: self.entries()[0])
    words[2] = host.removeprefix("ipv4:").partition(",")[0]  # as people write it, which the SDK does not take
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 1
    assert "expected STATUS_NONEXISTENT_SERVICE" in told.stdout
    told = CliRunner().invoke(app, [*words[:-1], "no_such_check"])
    assert "there is no check no_such_check" in str(told.exception)
    told = CliRunner().invoke(app, [*words[:1], "--robot", "127.0.0.1:1", *words[3:]])
    assert "127.0.0.1:1: " in str(told.exception)
    assert "check the address, the login, and --ca-file" in str(told.exception)


def test_the_table_stands_in_the_documentation() -> None:
    page = Path(__file__).parents[2] / "docs" / "conformance.md"
    assert markdown() in page.read_text(encoding="utf-8"), "run: make docs"


def _has_key(dotted: str) -> bool:
    part, key = dotted.split(".")
    return key in scenario_from_data({}).to_data()[part]
