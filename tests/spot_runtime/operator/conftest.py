"""A fake robot in lock-step, one arming driven in this process, and an operator who acts at instants of robot time."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import grpc
import pytest

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.sink import LogSink
from spot_model.policy.contract import sha256_hex
from spot_model.policy.policy import load_policy
from spot_model.robot.state import RobotState
from spot_protos import fake_admin_pb2, operator_pb2, run_link_pb2
from spot_protos.stub import stub
from spot_runtime.config import RunConfig, for_lock_step
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.base import Hal
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.host.clock import HostClock
from spot_runtime.operator.run.link import MAX_DATAGRAM_BYTES, RunLink
from spot_runtime.operator.run.operated_run import OperatedRun
from spot_runtime.operator.run.run_spec import RunSpec

POLICIES = Path(__file__).resolve().parents[3] / "policies"


def wait_until(condition: Callable[[], bool], what: str, timeout_s: float = 120.0) -> None:
    """Wait for what another thread or process does; the bound only ends a hang."""
    until_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > until_s:
            pytest.fail(f"never: {what}")
        time.sleep(0.02)


class Operator:
    """The other end of the link. ``acts`` holds what to do when, in seconds since the robot stood."""

    def __init__(self) -> None:
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours.setblocking(False)
        self.acts: list[tuple[float, Callable[[], None]]] = []
        self.repeats: list[tuple[float, float, Callable[[], None]]] = []
        self.reads = True
        self.told: list[run_link_pb2.FromRun] = []
        self._next_id = 0
        self._now_s = -1.0

    def at(self, seconds: float, act: Callable[[], None]) -> None:
        self.acts.append((seconds, act))
        self.acts.sort(key=lambda pair: pair[0])

    def every_tick(self, begin_s: float, end_s: float, act: Callable[[], None]) -> None:
        self.repeats.append((begin_s, end_s, act))

    def send(self, **what: Any) -> None:
        self._next_id += 1
        self.ours.send(run_link_pb2.ToRun(request_id=self._next_id, **what).SerializeToString())

    def steer(self, v_x: float) -> None:
        self.ours.send(run_link_pb2.ToRun(velocity=run_link_pb2.Velocity(v_x_m_s=v_x)).SerializeToString())

    def attend(self) -> None:
        self.ours.send(run_link_pb2.ToRun(attend=operator_pb2.AttendRequest()).SerializeToString())

    def live(self, now_s: float) -> None:
        """Do what is due."""
        while self.acts and self.acts[0][0] <= now_s:
            self.acts.pop(0)[1]()
        if now_s - self._now_s >= 0.02:
            self._now_s = now_s
            for begin_s, end_s, act in self.repeats:
                if begin_s <= now_s < end_s:
                    act()
        if self.reads:
            self.read()

    def read(self) -> None:
        while True:
            try:
                data = self.ours.recv(MAX_DATAGRAM_BYTES)
            except OSError:
                return
            if not data:
                return
            self.told.append(run_link_pb2.FromRun.FromString(data))

    @property
    def answers(self) -> dict[int, run_link_pb2.Answer]:
        return {m.answer.request_id: m.answer for m in self.told if m.WhichOneof("what") == "answer"}

    @property
    def events(self) -> list[str]:
        return [m.event.name for m in self.told if m.WhichOneof("what") == "event"]

    @property
    def states(self) -> list[str]:
        return [m.state for m in self.told if m.WhichOneof("what") == "state"]


class AttendedHal(BosdynHal):
    """The vendor's adapter; once the robot stands, each wait for a state is an occasion for the operator."""

    operator: Operator
    stood_ns: int = 0

    def stand(self) -> None:
        super().stand()
        self.stood_ns = self.stood_ns or self.robot_now_ns()

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        if self.stood_ns:  # a state is also read before the robot stands up
            self.operator.live((self.robot_now_ns() - self.stood_ns) / 1e9)
        return super().receive(until_robot_ns, timeout_s)


@dataclass
class Arming:
    """One arming of the fake robot."""

    address: FakeAddress
    admin: Any
    folder: Path
    operator: Operator = field(default_factory=Operator)

    def drive(self, policy: str = "walk", **service: Any) -> operator_pb2.Outcome:
        path = POLICIES / f"{policy}.onnx"
        config = for_lock_step(RunConfig())
        config = config.model_copy(
            update={
                "robot": config.robot.model_copy(update={"ca_file": self.address.ca_file}),
                "log": config.log.model_copy(update={"directory": self.folder}),
                "handover": config.handover.model_copy(update={"ramp_in_s": 1.0}),
                "service": config.service.model_copy(update=service),
            }
        )
        spec = RunSpec(
            robot=self.address.robot,
            config=config,
            policy=path,
            policy_sha256=sha256_hex(path.read_bytes()),
            labels={"operator": "tester"},
            lock_step=self.address.admin,
        )

        def make_hal(sink: LogSink) -> Hal:
            hal = AttendedHal(parse_address(spec.robot), config, sink, LockStep(spec.lock_step, HostClock().now_ns()))
            hal.operator = self.operator
            return hal

        link = RunLink(self.operator.theirs)
        try:
            run = OperatedRun(spec, load_policy(path), link, LoggerProcess.start, manager=None)
            outcome = run.drive(make_hal)
            self.operator.read()
        finally:
            link.close()
            self.operator.ours.close()
        return outcome

    def truth(self) -> Any:
        return self.admin.GetTruth(fake_admin_pb2.GetTruthRequest())

    def status(self) -> Any:
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    def inject(self, name: str, **texts: str) -> None:
        self.admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name=name, texts=texts))

    def is_at_rest(self) -> bool:
        """Sitting, without power, without a lease."""
        status = self.status()
        return status.motor_power.lower().endswith("off") and not status.lease_owner and not self.truth().has_fallen


@contextmanager
def armed_at(fake: FakeAddress, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Arming]:
    """A fake robot at this address, ready to be armed."""
    for name, value in fake.environment.items():
        monkeypatch.setenv(name, value)
    with grpc.insecure_channel(fake.admin) as channel:
        admin = stub(channel, fake_admin_pb2)
        yield Arming(fake, admin, folder)
        admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest())


@pytest.fixture
def arming(fake: FakeAddress, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Arming]:
    """A fake robot that sits, ready to be armed."""
    with armed_at(fake, tmp_path, monkeypatch) as armed:
        yield armed


@pytest.fixture
def spare_arming(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Arming]:
    """The same, of a robot that no other test needs."""
    with (
        FakeProcess(is_lock_step=True, state_dir=tmp_path / "state") as process,
        armed_at(process.address, tmp_path, monkeypatch) as armed,
    ):
        yield armed
