"""The conformance suite: our fake passes it, whatever its switches say, and a server with planted errors does not."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bosdyn.api import lease_pb2, robot_command_pb2, time_sync_pb2
from bosdyn.client.sdk import create_standard_sdk
from typer.testing import CliRunner

from fake_robot.conformance.check import Basis, Needs, Verdict
from fake_robot.conformance.command import run_suite
from fake_robot.conformance.server import Server
from fake_robot.conformance.table import CHECKS, markdown, run_checks
from fake_robot.robot import state_message, streamed_command
from fake_robot.robot.joint_control import JointControl
from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import scenario_from_data
from fake_robot.services.authority.estop_endpoints import EstopEndpoints
from fake_robot.services.authority.lease_records import LeaseRecords
from fake_robot.services.calls import access
from fake_robot.services.identity import directory_entries
from fake_robot.services.identity.time_sync_clients import TimeSyncClients
from fake_robot.services.identity.tokens import Credentials, LoginResult, TokenMint
from fake_robot.services.motion.robot_command import RobotCommandService
from fake_robot.start.commands import app
from fake_robot.start.server import FakeServer
from spot_model.errors import BadInputError

ALL_SETTINGS = [
    {},
    {"services": {"clock_identifier_check": "timed_commands", "missing_end_time_refusal": "invalid_request"}},
    {
        "services": {"second_command_stream": "evict", "missing_license_refusal": "invalid_request"},
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
def test_the_fake_passes_with_every_switch_either_way(serve: Serve, settings: dict[str, Any]) -> None:
    broken = [
        f"{r.check.name}: {r.seen}"
        for r in run_checks(serve(**settings), Needs.LEASE)
        if r.verdict in {Verdict.FAIL, Verdict.DIFFERS}
    ]
    assert not broken


def test_the_fake_walks_for_the_suite(serve: Serve) -> None:
    results = list(run_checks(serve(), Needs.MOTION, ("velocity_times_out", "trajectory_arrives")))
    assert [(r.check.name, r.seen) for r in results if r.verdict is not Verdict.PASS] == []


def _always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def _good_lease(_self: Any, _lease: Any, **_: Any) -> lease_pb2.LeaseUseResult:
    return lease_pb2.LeaseUseResult(status=lease_pb2.LeaseUseResult.STATUS_OK)


def _unsorted_stamps(build: Callable[..., bytes]) -> Callable[..., bytes]:
    """Every second message bears a stamp 5 ms old."""
    count = iter(range(10**9))
    return lambda self, report, stamp_ns, *rest: build(self, report, stamp_ns - 5_000_000 * (next(count) % 2), *rest)


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
}
"""What is wrong with the server, how it is planted, and the checks that must find it."""


def _padded(field: Any) -> Any:
    import numpy as np

    return np.resize(np.array(field[:], dtype=np.float64), 12)[np.newaxis]


@pytest.mark.parametrize("error", PLANTED)
def test_a_planted_error_is_found(serve: Serve, monkeypatch: pytest.MonkeyPatch, error: str) -> None:
    plant, finders = PLANTED[error]
    server = serve()
    plant(monkeypatch)
    results = {r.check.name: r for r in run_checks(server, Needs.LEASE, tuple(finders))}
    missed = {name for name in finders if results[name].verdict is not Verdict.FAIL}
    assert not missed, {name: results[name].seen for name in missed}


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
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 1
    assert "expected STATUS_NONEXISTENT_SERVICE" in told.stdout
    told = CliRunner().invoke(app, [*words[:-1], "no_such_check"])
    assert "there is no check no_such_check" in str(told.exception)


def test_the_table_stands_in_the_documentation() -> None:
    page = Path(__file__).parents[2] / "docs" / "conformance.md"
    assert markdown() in page.read_text(encoding="utf-8"), "run: make docs"


def _has_key(dotted: str) -> bool:
    part, key = dotted.split(".")
    return key in scenario_from_data({}).to_data()[part]
