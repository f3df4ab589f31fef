"""Time sync against a robot that was written by hand: strict about identifiers, and with a wall clock that is set."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import grpc
import pytest
from bosdyn.api import (
    header_pb2,
    robot_command_pb2,
    robot_command_service_pb2_grpc,
    time_sync_pb2,
)
from bosdyn.client.robot_command import NoTimeSyncError, RobotCommandBuilder

from spot_runtime.hal.errors import ClockError
from spot_runtime.hal.time_sync import ATTEMPTS, SyncedCommandClient, TimeSync
from spot_runtime.host.clock import HostClock

IDENTIFIER = "client-17"
OK = header_pb2.CommonError.CODE_OK


class StrictCommands(robot_command_service_pb2_grpc.RobotCommandServiceServicer):
    """Refuses every command of a client whose clock it does not know, as the proto's STATUS_NO_TIMESYNC says."""

    def RobotCommand(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        answer = robot_command_pb2.RobotCommandResponse(robot_command_id=1)
        answer.header.error.code = OK
        is_known = request.clock_identifier == IDENTIFIER
        answer.status = answer.STATUS_OK if is_known else answer.STATUS_NO_TIMESYNC
        return answer


@pytest.fixture
def client() -> Iterator[SyncedCommandClient]:
    server = grpc.server(ThreadPoolExecutor(2))
    robot_command_service_pb2_grpc.add_RobotCommandServiceServicer_to_server(StrictCommands(), server)
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        made = SyncedCommandClient()
        made.channel = channel
        yield made
    server.stop(None)


class TimeSyncService:
    """Answers as the SDK's client would; ``during`` happens while the answer is under way."""

    def __init__(self, robot_minus_unix_ns: int = 0) -> None:
        self.robot_minus_unix_ns = robot_minus_unix_ns
        self.during = lambda: None
        self.identifier = IDENTIFIER
        self.status = time_sync_pb2.TimeSyncState.STATUS_OK
        self.asked: list[tuple[Any, str]] = []
        self.timeouts_s: list[float] = []

    def get_time_sync_update(self, previous: Any, clock_identifier: str, *, timeout: float) -> Any:
        self.asked.append((previous, clock_identifier))
        self.timeouts_s.append(timeout)
        answer = time_sync_pb2.TimeSyncUpdateResponse(clock_identifier=self.identifier)
        answer.header.request_header.request_timestamp.FromNanoseconds(time.time_ns())
        answer.header.request_received_timestamp.FromNanoseconds(time.time_ns() + self.robot_minus_unix_ns)
        self.during()
        answer.header.response_timestamp.CopyFrom(answer.header.request_received_timestamp)
        answer.state.status = self.status
        return answer


def test_a_robot_that_does_not_know_the_client_is_synced_with_anew(client: SyncedCommandClient) -> None:
    """As one that was rebooted does not, or one whose time-sync service was."""
    service = TimeSyncService()
    sync = TimeSync(service, HostClock(), 1.0)
    client.use(sync)
    sync.round_trip()
    sync.clock_identifier = "of-another-boot"
    assert client.synced(lambda: client.robot_command(RobotCommandBuilder.synchro_stand_command())) == 1
    assert service.asked == [(None, ""), (None, "")]
    assert sync.clock_identifier == IDENTIFIER


def test_a_robot_that_knows_no_client_refuses_the_second_command_too(
    client: SyncedCommandClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = TimeSyncService()
    monkeypatch.setattr(service, "identifier", "another-client")
    client.use(TimeSync(service, HostClock(), 1.0))
    with pytest.raises(NoTimeSyncError):
        client.synced(lambda: client.robot_command(RobotCommandBuilder.synchro_stand_command()))


@pytest.mark.parametrize("stamp", ["request_received_timestamp", "response_timestamp"])
def test_an_answer_without_stamps_says_nothing_of_the_robots_clock(monkeypatch: pytest.MonkeyPatch, stamp: str) -> None:
    """Read as zeros, they would be a clock of 1970, and every state then comes from the future."""
    service = TimeSyncService()
    whole = service.get_time_sync_update

    def without_stamp(*asked: Any, timeout: float) -> Any:
        answer = whole(*asked, timeout=timeout)
        answer.header.ClearField(stamp)
        return answer

    monkeypatch.setattr(service, "get_time_sync_update", without_stamp)
    with pytest.raises(ClockError, match="bears no stamps"):
        TimeSync(service, HostClock(), 1.0).round_trip()


@pytest.mark.parametrize("status", [time_sync_pb2.TimeSyncState.STATUS_SERVICE_NOT_READY, 9], ids=["known", "newer"])
def test_a_sync_that_is_not_reached_is_given_up(status: int) -> None:
    service = TimeSyncService()
    service.status = status
    sync = TimeSync(service, HostClock(), 1.0)
    sync.renew("")
    assert len(service.asked) == ATTEMPTS
    assert not sync.is_established


class Clock(HostClock):
    """Shows what it is told."""

    def __init__(self) -> None:
        self.shown_ns = 1_700_000_000_000_000_000

    def now_ns(self) -> int:
        return self.shown_ns


def test_a_sync_that_takes_too_long_is_given_up_after_one_time_out() -> None:
    service, clock = TimeSyncService(), Clock()
    service.status = time_sync_pb2.TimeSyncState.STATUS_MORE_SAMPLES_NEEDED

    def takes_long() -> None:
        clock.shown_ns += 400_000_000

    service.during = takes_long
    sync = TimeSync(service, clock, 1.0)
    sync.renew("")
    assert service.timeouts_s == pytest.approx([1.0, 0.6, 0.2])


def test_others_get_their_turn_between_the_round_trips_of_a_new_sync() -> None:
    service, sync_lock = TimeSyncService(), threading.RLock()
    trips_of_turns: list[int] = []

    class Turns:
        def __enter__(self) -> None:
            sync_lock.acquire()
            trips_of_turns.append(-len(service.asked))

        def __exit__(self, *_: object) -> None:
            trips_of_turns[-1] += len(service.asked)
            sync_lock.release()

    service.status = time_sync_pb2.TimeSyncState.STATUS_MORE_SAMPLES_NEEDED
    sync = TimeSync(service, HostClock(), 60.0)
    sync._lock = Turns()  # type: ignore[assignment]
    sync.renew("")
    assert max(trips_of_turns) == 1
    assert sum(trips_of_turns) == ATTEMPTS


def test_a_new_sync_that_another_thread_has_made_serves_and_commands_bear_an_identifier_meanwhile() -> None:
    service, borne = TimeSyncService(), []
    sync = TimeSync(service, HostClock(), 1.0)
    sync.round_trip()
    sync.renew("of-another-boot")
    assert len(service.asked) == 1
    service.identifier = "client-18"
    service.during = lambda: borne.append(sync.clock_identifier)
    sync.renew(IDENTIFIER)
    assert borne == [IDENTIFIER]
    assert sync.clock_identifier == "client-18"


def test_every_command_after_the_first_answer_carries_the_identifier(client: SyncedCommandClient) -> None:
    sync = TimeSync(TimeSyncService(), HostClock(), 1.0)
    client.use(sync)
    sync.round_trip()
    assert client.robot_command(RobotCommandBuilder.synchro_stand_command()) == 1
    assert client.robot_command(RobotCommandBuilder.safe_power_off_command()) == 1


def test_the_client_begins_no_time_sync_of_its_own() -> None:
    class Robot(SimpleNamespace):
        @property
        def time_sync(self) -> Any:
            raise AssertionError("a time sync was begun")

    robot = Robot(
        request_processors=[],
        response_processors=[],
        lease_wallet=None,
        client_name="me",
        logger=logging.getLogger("robot"),
    )
    robot.logger = logging.getLogger("robot")
    robot.executor, robot.cert, robot.user_token = None, None, ""
    client = SyncedCommandClient()
    client.update_from(robot)
    assert client.client_name == "me"


def test_the_identifier_of_one_answer_goes_with_the_next_question() -> None:
    service = TimeSyncService()
    sync = TimeSync(service, HostClock(), 1.0)
    sync.round_trip()
    sync.round_trip()
    assert service.asked[0] == (None, "")
    assert service.asked[1][1] == IDENTIFIER
    assert service.asked[1][0].client_rx.ToNanoseconds() >= service.asked[1][0].client_tx.ToNanoseconds()


@pytest.mark.parametrize("step_s", [-3600.0, -0.5, 0.5, 3600.0])
def test_a_wall_clock_that_steps_while_the_answer_is_under_way_moves_no_robot_clock(
    monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    real, step_ns = time.time_ns, [0]
    monkeypatch.setattr(time, "time_ns", lambda: real() + step_ns[0])
    service, clock = TimeSyncService(), HostClock()
    sync = TimeSync(service, clock, 1.0)
    skew_ns = sync.round_trip().skew_ns

    def step() -> None:
        step_ns[0] = round(step_s * 1e9)

    service.during = step
    stepped = sync.round_trip()
    assert 0 <= stepped.round_trip_ns < 0.1e9
    assert abs(stepped.skew_ns - skew_ns) < 0.1e9
    sync.round_trip()
    previous = service.asked[-1][0]
    assert 0 <= previous.client_rx.ToNanoseconds() - previous.client_tx.ToNanoseconds() < 0.1e9
