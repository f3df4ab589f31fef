"""A lease whose grant got lost on the way, and a token that the robot does not take; by a stranger's robot."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import grpc
import pytest
from bosdyn.api import auth_pb2, header_pb2, lease_pb2, lease_service_pb2_grpc
from bosdyn.client import auth
from bosdyn.client import exceptions as sdk
from bosdyn.client.lease import Lease, LeaseClient, LeaseWallet, LeaseWalletResponseProcessor
from bosdyn.client.robot_command import RobotCommandStreamingClient
from bosdyn.client.robot_state import RobotStateStreamingClient

from spot_runtime.config import RobotConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.credentials import PASSWORD_VARIABLE, USERNAME_VARIABLE
from spot_runtime.hal.errors import CredentialsError, HalError, LeaseHeldError
from spot_runtime.hal.spot.calls import BODY, Calls
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from tests.spot_runtime.test_hal_parts import _FailedCall

US, OTHER = "spot-rl of this process", "a tablet"


def new_session() -> RobotCalls:
    clock = HostClock()
    return RobotCalls(parse_address("127.0.0.1:1"), RobotConfig(), clock, RobotClockEstimate(), clock.now_ns)


# The lease -----------------------------------------------------------------------------------------------------------


@dataclass
class StrangeLeases(lease_service_pb2_grpc.LeaseServiceServicer):
    """Grants to whoever asks first, and never to the same one twice; its first answers get lost."""

    owner: str = ""
    lost: list[grpc.StatusCode] = field(default_factory=list)
    grants: bool = True
    """Whether a call whose answer gets lost has been carried out."""
    taken_by: str = ""
    """Who takes the lease by force just before it is listed."""
    root: int = 1
    asked: int = 0
    newest: lease_pb2.Lease | None = None
    """That it has seen; an older one is refused, also to retain."""
    overtakes: Callable[[], None] = lambda: None
    """What arrives before a retain does."""

    def AcquireLease(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        self.asked += 1
        code = self.lost.pop(0) if self.lost else None
        answer = lease_pb2.AcquireLeaseResponse(status=lease_pb2.AcquireLeaseResponse.STATUS_OK)
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        if self.owner:
            answer.status = lease_pb2.AcquireLeaseResponse.STATUS_RESOURCE_ALREADY_CLAIMED
        elif code is None or self.grants:
            self.owner, self.root = US, self.root + 1
            answer.lease.CopyFrom(self._lease())
        answer.lease_owner.client_name = self.owner
        if code is not None:
            context.abort(code, "the answer got lost")
        return answer

    def ListLeases(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        if self.taken_by:
            self.owner, self.root = self.taken_by, self.root + 1
        answer = lease_pb2.ListLeasesResponse()
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        entry = answer.resources.add(resource=BODY, lease=self._lease())
        entry.lease_owner.client_name = self.owner
        return answer

    def RetainLease(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        self.asked += 1
        self.overtakes()
        answer = lease_pb2.RetainLeaseResponse()
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        use, lease = answer.lease_use_result, Lease(request.lease)
        newest = Lease(self.newest or self._lease())
        is_older = lease.compare(newest) in (Lease.CompareResult.OLDER, Lease.CompareResult.SUPER_LEASE)
        use.status = use.STATUS_OLDER if is_older else use.STATUS_OK
        use.attempted_lease.CopyFrom(request.lease)
        use.latest_known_lease.CopyFrom(newest.lease_proto)
        return answer

    def _lease(self) -> lease_pb2.Lease:
        return lease_pb2.Lease(resource=BODY, epoch="e", sequence=[self.root])


@pytest.fixture
def leases() -> StrangeLeases:
    return StrangeLeases()


@pytest.fixture
def session(leases: StrangeLeases, monkeypatch: pytest.MonkeyPatch) -> Iterator[RobotCalls]:
    server = grpc.server(ThreadPoolExecutor(2))
    lease_service_pb2_grpc.add_LeaseServiceServicer_to_server(leases, server)
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    made = new_session()
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        wallet = LeaseWallet()
        client = LeaseClient(wallet)
        client.channel = channel
        client.response_processors.append(LeaseWalletResponseProcessor(wallet))
        robot = SimpleNamespace(ensure_client=lambda _: client, lease_wallet=wallet)
        monkeypatch.setattr(made, "_robot", robot)
        monkeypatch.setattr(made, "_client_name", US)
        monkeypatch.setattr(made, "calls", Calls(robot))
        yield made
    server.stop(None)


UNAVAILABLE, DEADLINE = grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED


@pytest.mark.parametrize(
    ("lost", "asked"),
    [([], 1), ([UNAVAILABLE], 2), ([DEADLINE], 2), ([UNAVAILABLE, UNAVAILABLE], 3), ([DEADLINE, UNAVAILABLE], 3)],
)
def test_a_lease_whose_grant_got_lost_is_ours(
    session: RobotCalls, leases: StrangeLeases, lost: list[grpc.StatusCode], asked: int
) -> None:
    leases.lost = lost
    session.acquire_lease()
    assert session.has_lease
    assert (list(session.lease.sequence), leases.asked) == ([2], asked)
    assert session._robot.lease_wallet.advance().lease_proto.sequence[0] == 2


@pytest.mark.parametrize("code", [UNAVAILABLE, DEADLINE])
def test_a_call_that_never_arrived_is_made_again(
    session: RobotCalls, leases: StrangeLeases, code: grpc.StatusCode
) -> None:
    leases.lost, leases.grants = [code], False
    session.acquire_lease()
    assert (list(session.lease.sequence), leases.asked) == ([2], 2)


@pytest.mark.parametrize(("owner", "lost"), [(OTHER, []), (OTHER, [UNAVAILABLE]), (OTHER, [DEADLINE]), (US, [])])
def test_a_lease_of_anybody_else_is_not_touched(
    session: RobotCalls, leases: StrangeLeases, owner: str, lost: list[grpc.StatusCode]
) -> None:
    """Nor one of this process that was not asked for just now: two of its robots have one name."""
    leases.owner, leases.lost = owner, lost
    with pytest.raises(LeaseHeldError, match=f"held by {owner}"):
        session.acquire_lease()
    assert not session.has_lease


def test_a_lease_that_is_taken_from_us_at_once_is_not_ours(session: RobotCalls, leases: StrangeLeases) -> None:
    leases.lost, leases.taken_by = [UNAVAILABLE], OTHER
    with pytest.raises(LeaseHeldError):
        session.acquire_lease()
    assert not session.has_lease


def test_a_command_that_overtakes_a_keep_alive_has_not_taken_the_lease(
    session: RobotCalls, leases: StrangeLeases
) -> None:
    session.acquire_lease()
    wallet, times = session._robot.lease_wallet, [2]

    def command() -> None:
        if times[0]:
            times[0] -= 1
            leases.newest = wallet.advance().lease_proto

    leases.asked, leases.overtakes = 0, command
    session.retain_lease()
    assert leases.asked == 3
    leases.newest = lease_pb2.Lease(resource=BODY, epoch="e", sequence=[3])
    with pytest.raises(LeaseHeldError):
        session.retain_lease()
    assert leases.asked == 4


@pytest.mark.parametrize("lost", [[DEADLINE, DEADLINE], [grpc.StatusCode.INTERNAL]])
def test_two_time_outs_are_an_end_and_so_is_any_other_error(
    session: RobotCalls, leases: StrangeLeases, lost: list[grpc.StatusCode]
) -> None:
    leases.lost, asked = lost, len(lost)
    with pytest.raises(HalError, match="taking the lease: the robot did not answer"):
        session.acquire_lease()
    assert leases.asked == asked


# The token -----------------------------------------------------------------------------------------------------------


@dataclass
class StrangeLogin:
    """What the SDK's robot is to a login."""

    by_token: Callable[[], None]
    learns: Callable[[], None] = lambda: None
    passwords: int = 0

    def authenticate_with_token(self, _token: str, timeout: float) -> None:
        self.by_token()

    def authenticate(self, _username: str, _password: str, timeout: float) -> None:
        self.passwords += 1

    def get_cached_robot_id(self, timeout: float) -> Any:
        if not self.passwords:
            self.learns()
        return SimpleNamespace(serial_number="spot-1", nickname="rex")

    def sync_with_directory(self) -> None: ...

    def _shutdown(self) -> None: ...

    def shutdown(self) -> None: ...


def log_in(robot: StrangeLogin, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv(USERNAME_VARIABLE, "user")
    monkeypatch.setenv(PASSWORD_VARIABLE, "password")
    session = new_session()

    def make_robot() -> bytes:
        session._robot = robot
        return b""

    monkeypatch.setattr(session, "_make_robot", make_robot)
    return session.log_in("a token")


def fails(error: Exception) -> Callable[[], None]:
    def fail() -> None:
        raise error

    return fail


def answered(kind: type[Exception]) -> Exception:
    return kind(auth_pb2.GetAuthTokenResponse(), "as told")


def failed(kind: type[Exception], code: grpc.StatusCode) -> Exception:
    return kind(_FailedCall("as told", code), "doc")


UNAUTHENTICATED = failed(sdk.UnauthenticatedError, grpc.StatusCode.UNAUTHENTICATED)


@pytest.mark.parametrize(
    "robot",
    [
        StrangeLogin(fails(answered(auth.InvalidTokenError))),
        StrangeLogin(fails(UNAUTHENTICATED)),
        StrangeLogin(lambda: None, fails(UNAUTHENTICATED)),
    ],
)
def test_a_token_that_is_not_valid_gives_way_to_the_password(
    robot: StrangeLogin, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert log_in(robot, monkeypatch) == "spot-1 rex"
    assert robot.passwords == 1


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (failed(sdk.TimedOutError, DEADLINE), HalError),
        (failed(sdk.UnableToConnectToRobotError, UNAVAILABLE), HalError),
        (failed(sdk.PermissionDeniedError, grpc.StatusCode.PERMISSION_DENIED), CredentialsError),
        (answered(auth.TemporarilyLockedOutError), CredentialsError),
        (failed(sdk.RpcError, grpc.StatusCode.INTERNAL), HalError),
    ],
)
@pytest.mark.parametrize("when", ["token", "learn"])
def test_no_other_trouble_sends_the_password(
    error: Exception, kind: type[HalError], when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = StrangeLogin(fails(error)) if when == "token" else StrangeLogin(lambda: None, fails(error))
    with pytest.raises(kind):
        log_in(robot, monkeypatch)
    assert robot.passwords == 0


def test_a_token_that_is_valid_needs_no_password(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = StrangeLogin(lambda: None)
    assert log_in(robot, monkeypatch) == "spot-1 rex"
    assert robot.passwords == 0


# Channels ------------------------------------------------------------------------------------------------------------


def test_a_session_that_ends_at_once_leaves_no_thread_with_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot may have both streaming services at one authority, and then they share a channel."""
    errors: list[Any] = []
    monkeypatch.setattr(threading, "excepthook", errors.append)
    server = grpc.server(ThreadPoolExecutor(2))
    channel = grpc.insecure_channel(f"127.0.0.1:{server.add_insecure_port('127.0.0.1:0')}")
    server.start()
    session = new_session()
    session._robot = SimpleNamespace(ensure_channel=lambda _name, **_: channel)
    before = set(threading.enumerate())
    for service in (RobotCommandStreamingClient, RobotStateStreamingClient):
        assert session.streaming_channel(service) is channel
    channel.close()
    for thread in set(threading.enumerate()) - before:
        thread.join(10.0)
    server.stop(None)
    assert not errors
