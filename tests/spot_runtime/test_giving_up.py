"""A robot that is given up is asked for no motion again; over the wire, by a stranger's robot that turns calls away."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import grpc
import numpy as np
import pytest
from bosdyn.api import (
    header_pb2,
    lease_pb2,
    power_pb2,
    power_service_pb2_grpc,
    robot_command_pb2,
    robot_command_service_pb2_grpc,
    robot_state_pb2,
    robot_state_service_pb2_grpc,
)
from bosdyn.client.exceptions import UnableToConnectToRobotError
from bosdyn.client.lease import Lease, LeaseWallet, add_lease_wallet_processors
from bosdyn.client.power import PowerClient
from bosdyn.client.robot_state import RobotStateClient

from fake_robot.start.process import FakeAddress
from spot_log.write.sink import MemorySink
from spot_model.robot.state import Gains, JointCommand
from spot_protos import fake_admin_pb2
from spot_runtime.config import RunConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.base import JointControl
from spot_runtime.hal.errors import MotionError
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.calls import Calls
from spot_runtime.hal.spot.motions import Helm
from spot_runtime.hal.time_sync import SyncedCommandClient, TimeSync
from spot_runtime.host.clock import HostClock
from spot_runtime.stops import Stop, StopReason
from tests.spot_runtime.test_hal_parts import _FailedCall
from tests.spot_runtime.test_time_sync import TimeSyncService

PATIENCE_S = 30.0
POWER = robot_state_pb2.PowerState


@dataclass
class Stranger(
    robot_command_service_pb2_grpc.RobotCommandServiceServicer,
    robot_command_service_pb2_grpc.RobotCommandStreamingServiceServicer,
    robot_state_service_pb2_grpc.RobotStateServiceServicer,
    power_service_pb2_grpc.PowerServiceServicer,
):
    """A robot by another hand. The first command of one kind waits, then gets the answer that a test wants."""

    held: str = ""
    answer: Callable[[Any, Any], None] = lambda _answer, _context: None
    off_after: int = 1
    """The power-off that it carries out; it refuses those before."""
    has_arrived: threading.Event = field(default_factory=threading.Event)
    may_answer: threading.Event = field(default_factory=threading.Event)
    asked: list[str] = field(default_factory=list)
    leases: list[Lease] = field(default_factory=list)
    power: int = POWER.MOTOR_POWER_STATE_ON

    def RobotCommand(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        full, mobility = request.command.full_body_command, request.command.synchronized_command.mobility_command
        kind = (full.WhichOneof("command") or mobility.WhichOneof("command")).removesuffix("_request")
        self.asked.append(kind)
        self.leases.append(Lease(request.lease))
        answer = robot_command_pb2.RobotCommandResponse(robot_command_id=len(self.asked))
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        answer.status = answer.STATUS_OK
        if kind == self.held and self.asked.count(kind) == 1:
            self.has_arrived.set()
            self.may_answer.wait(PATIENCE_S)
            self.answer(answer, context)
        elif kind == "safe_power_off" and self.asked.count(kind) < self.off_after:
            answer.status, answer.message = answer.STATUS_BEHAVIOR_FAULT, "a fault that passes"
        elif kind == "safe_power_off":
            self.power = POWER.MOTOR_POWER_STATE_OFF
        return answer

    def JointControlStream(self, request_iterator: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        for _ in request_iterator:
            pass
        return robot_command_pb2.JointControlStreamResponse(status=1)

    def GetRobotState(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        answer = robot_state_pb2.RobotStateResponse()
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        answer.robot_state.power_state.motor_power_state = self.power
        return answer

    def PowerCommand(self, request: Any, context: Any) -> Any:  # noqa: N802 - the service's name
        self.asked.append(power_pb2.PowerCommandRequest.Request.Name(request.request))
        answer = power_pb2.PowerCommandResponse(status=power_pb2.STATUS_SUCCESS, license_status=1)
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        answer.lease_use_result.status = lease_pb2.LeaseUseResult.STATUS_OK
        return answer


@pytest.fixture
def stranger() -> Iterator[Stranger]:
    robot = Stranger()
    yield robot
    robot.may_answer.set()


@pytest.fixture
def hal(stranger: Stranger, monkeypatch: pytest.MonkeyPatch) -> Iterator[BosdynHal]:
    """Connected to that robot, which stands and has power."""
    server = grpc.server(ThreadPoolExecutor(8))
    robot_command_service_pb2_grpc.add_RobotCommandServiceServicer_to_server(stranger, server)
    robot_command_service_pb2_grpc.add_RobotCommandStreamingServiceServicer_to_server(stranger, server)
    robot_state_service_pb2_grpc.add_RobotStateServiceServicer_to_server(stranger, server)
    power_service_pb2_grpc.add_PowerServiceServicer_to_server(stranger, server)
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    hal = BosdynHal(parse_address("127.0.0.1:1"), RunConfig(), MemorySink())
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        wallet, clients = LeaseWallet(), (SyncedCommandClient(), RobotStateClient(), PowerClient())
        for client in clients:
            client.channel = channel
        add_lease_wallet_processors(clients[2], wallet)
        clients[0].use(TimeSync(TimeSyncService(), HostClock(), 1.0))
        by_name = {client.default_service_name: client for client in clients}
        robot = SimpleNamespace(ensure_client=by_name.__getitem__, lease_wallet=wallet)
        monkeypatch.setattr(hal._session, "_robot", robot)
        monkeypatch.setattr(hal._session, "calls", Calls(robot))
        monkeypatch.setattr(hal, "_command_channel", channel)
        hal._session.adopt_lease(lease_pb2.Lease(resource="body", epoch="e", sequence=[2]))
        yield hal
        stranger.may_answer.set()
        hal.release()
        threads_end()
    server.stop(None)


def threads_end() -> None:
    """Wait until whatever was begun beside the loop is done."""
    for thread in threading.enumerate():
        if thread.name == "activation":
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


def command(gains: Gains | None = None) -> JointCommand:
    zeros = np.zeros(12)
    return JointCommand(1, zeros, zeros, zeros, gains or Gains.stand(), 1)


def turned_away(_answer: Any, context: Any) -> None:
    context.abort(grpc.StatusCode.UNAVAILABLE, "the connection was closed")


def not_synced(answer: Any, _context: Any) -> None:
    answer.status = answer.STATUS_NO_TIMESYNC


def carried_out(_answer: Any, _context: Any) -> None: ...


def begin(hal: BosdynHal, kind: str) -> None:
    hal.begin_joint_control(command())
    if kind == "stand":
        threads_end()
        assert hal.joint_control is JointControl.ACTIVE
        hal.end_joint_control()


def damp(hal: BosdynHal) -> None:
    zeros = np.zeros(12)
    hal.send(command(Gains(zeros, zeros + 5.0)))


GIVING_UP: dict[str, Callable[[BosdynHal], None]] = {
    "power_off": BosdynHal.power_off,
    "release": BosdynHal.release,
    "estop": BosdynHal.estop,
    "damp": damp,
}


@pytest.mark.parametrize("kind", ["joint", "stand"])
@pytest.mark.parametrize("answer", [turned_away, not_synced])
@pytest.mark.parametrize("gives_up", GIVING_UP.values(), ids=GIVING_UP)
def test_no_motion_is_asked_for_again_once_the_robot_is_given_up(
    hal: BosdynHal,
    stranger: Stranger,
    kind: str,
    answer: Callable[[Any, Any], None],
    gives_up: Callable[[BosdynHal], None],
) -> None:
    stranger.held, stranger.answer = kind, answer
    begin(hal, kind)
    assert stranger.has_arrived.wait(PATIENCE_S)
    gives_up(hal)
    stranger.may_answer.set()
    threads_end()
    assert stranger.asked.count(kind) == 1
    if gives_up is BosdynHal.power_off:
        assert stranger.asked[-1] == "safe_power_off"
    # What the given-up motion came to is no longer told, as of a run that goes on.
    assert list(hal.problems()) == []
    hal.power_off()
    assert stranger.power == POWER.MOTOR_POWER_STATE_OFF


@pytest.mark.parametrize("kind", ["joint", "stand"])
@pytest.mark.parametrize("answer", [turned_away, not_synced])
def test_while_it_is_wanted_a_motion_is_asked_for_again(
    hal: BosdynHal, stranger: Stranger, kind: str, answer: Callable[[Any, Any], None]
) -> None:
    stranger.held, stranger.answer = kind, answer
    stranger.may_answer.set()
    begin(hal, kind)
    threads_end()
    assert stranger.asked == [*(["joint"] if kind == "stand" else []), kind, kind]
    assert hal.joint_control is (JointControl.OFF if kind == "stand" else JointControl.ACTIVE)


def test_a_motion_that_is_overtaken_on_its_way_has_the_older_lease(hal: BosdynHal, stranger: Stranger) -> None:
    """So the robot itself refuses it, whichever of the two it takes up first."""
    begin(hal, "joint")
    threads_end()
    hal.power_off()
    assert stranger.asked == ["joint", "safe_power_off"]
    joint, off = stranger.leases
    assert joint.compare(off) is Lease.CompareResult.OLDER


@pytest.mark.parametrize("answer", [carried_out, turned_away])
def test_a_late_answer_changes_nothing_of_what_came_after(
    hal: BosdynHal, stranger: Stranger, answer: Callable[[Any, Any], None]
) -> None:
    stranger.held, stranger.answer = "joint", answer
    begin(hal, "joint")
    assert stranger.has_arrived.wait(PATIENCE_S)
    hal.release()
    hal.begin_joint_control(command())
    hal.release()
    stranger.may_answer.set()
    threads_end()
    assert hal.joint_control is JointControl.OFF
    assert list(hal.problems()) == []


def test_the_helm_gives_leases_to_its_holder_alone() -> None:
    numbers = iter(range(10))
    helm, first, second = Helm(lambda: next(numbers)), object(), object()
    did: list[object] = []
    helm.hand_to(first)
    assert (helm.lease_for(first), helm.lease_for(first)) == (0, 1)
    helm.hand_to(second)
    for stale in (first, None):
        with pytest.raises(MotionError, match="no longer wanted"):
            helm.lease_for(stale)
    helm.do_for(first, lambda: did.append(first))
    helm.do_for(second, lambda: did.append(second))
    assert (helm.lease_for(second), did) == (2, [second])


# Power off -----------------------------------------------------------------------------------------------------------


def test_a_robot_that_refuses_to_power_off_is_asked_again(
    hal: BosdynHal, stranger: Stranger, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hal._pace, "pause", lambda _: None)
    stranger.off_after = 4
    hal.power_off()
    assert stranger.asked == ["safe_power_off"] * 4
    assert stranger.power == POWER.MOTOR_POWER_STATE_OFF


def test_a_pressed_estop_is_no_reason_to_stop_powering_off(
    hal: BosdynHal, stranger: Stranger, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when check-ins go on failing after the loop has ended."""
    monkeypatch.setattr(hal._pace, "pause", lambda _: None)
    hal._problems.append(Stop(StopReason.ESTOPPED, "endpoint unknown"))
    stranger.off_after = 2
    hal.power_off()
    assert stranger.power == POWER.MOTOR_POWER_STATE_OFF


@pytest.mark.parametrize("off_after", [1, 99])
def test_power_that_may_still_come_on_is_switched_off(
    hal: BosdynHal, stranger: Stranger, monkeypatch: pytest.MonkeyPatch, off_after: int
) -> None:
    """An operator interrupts the wait for the answer to a power-on, which may arrive after a look at the motors."""
    monkeypatch.setattr(hal._pace, "pause", lambda _: None)
    stranger.off_after = off_after

    class InterruptError(BaseException):
        """As a signal's handler raises it."""

    def interrupted(*_: object, **__: object) -> None:
        raise InterruptError

    stranger.power = POWER.MOTOR_POWER_STATE_OFF
    hal.power_off()
    assert stranger.asked == []
    power: Any = hal._session.calls.client(PowerClient)
    monkeypatch.setattr(power, "power_command", interrupted)
    with pytest.raises(InterruptError):
        hal.stand()
    hal.power_off()
    assert stranger.asked == ["safe_power_off"]


def test_an_error_of_any_kind_beside_the_loop_is_told(
    hal: BosdynHal, stranger: Stranger, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread that ends without a word leaves the loop waiting for it."""

    def broken(*_: object, **__: object) -> None:
        raise TypeError("a message that no code expects")

    client: Any = hal._session.calls.client(SyncedCommandClient)
    begin(hal, "joint")
    threads_end()
    monkeypatch.setattr(client, "robot_command", broken)
    hal.end_joint_control()
    threads_end()
    assert (hal.joint_control, hal.problems()[0].reason) == (JointControl.ACTIVE, StopReason.HAND_BACK_FAILED)
    hal.begin_joint_control(command())
    threads_end()
    assert (hal.joint_control, hal.problems()[0].reason) == (JointControl.FAILED, StopReason.ACTIVATION_FAILED)
    monkeypatch.setattr(hal._session, "cut_power", broken)
    hal.estop()
    threads_end()
    assert "could not be pressed: a message that no code expects" in hal.problems()[0].sentence()


def test_a_lease_that_the_wallet_has_lost_is_told_as_one(hal: BosdynHal, stranger: Stranger) -> None:
    """The SDK's wallet raises errors that are none of the SDK's own."""
    hal._session._robot.lease_wallet.remove(hal._session._lease)
    with pytest.raises(Exception, match="see who holds the lease") as caught:
        hal._motions().power_off(even_if_off=True)
    assert type(caught.value).__name__ == "LeaseHeldError"
    assert stranger.asked == []


# On the fake robot ---------------------------------------------------------------------------------------------------

IS_LOCK_STEP = False
"""In real time a motion is asked for by a thread of its own."""


@pytest.mark.parametrize("is_overtaken", [False, True])
def test_the_fake_robot_sits_and_powers_off_although_a_call_for_joint_control_is_under_way(
    fake: FakeAddress, admin: Any, monkeypatch: pytest.MonkeyPatch, is_overtaken: bool
) -> None:
    """The call is turned away and may be made again, or has its lease and is overtaken, once the robot is to sit."""
    for name, value in fake.environment.items():
        monkeypatch.setenv(name, value)
    robot = RunConfig().robot.model_copy(update={"ca_file": fake.ca_file})
    hal = BosdynHal(parse_address(fake.robot), RunConfig().model_copy(update={"robot": robot}), MemorySink())
    hal.connect()
    hal.stand()
    client: Any = hal._session.calls.client(SyncedCommandClient)
    call, sits, sent = client.call, threading.Event(), []

    def delayed(method: Any, request: Any, *arguments: Any, **keywords: Any) -> Any:
        kind = request.command.full_body_command.WhichOneof("command")
        sent.append(kind)
        if kind == "joint_request" and len(sent) == 1:
            assert sits.wait(PATIENCE_S)
            if not is_overtaken:
                raise UnableToConnectToRobotError(_FailedCall(), "doc")
        answer = call(method, request, *arguments, **keywords)
        if kind == "safe_power_off_request":
            sits.set()
            threads_end()
        return answer

    monkeypatch.setattr(client, "call", delayed)
    hal.begin_joint_control(command())
    while not sent:
        threading.Event().wait(0.001)
    hal.power_off()
    assert sent == ["joint_request", "safe_power_off_request"]
    assert admin.GetStatus(fake_admin_pb2.GetStatusRequest()).motor_power == "off"
    assert hal._session.newest_lease("body").sequence[0] == hal._session.lease.sequence[0]
    hal._session.retain_lease()
    hal.close()
