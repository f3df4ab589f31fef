"""A fake robot, and runs against it that something happens to at a chosen instant of robot time."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import grpc
import numpy as np
from bosdyn.api import power_pb2
from bosdyn.client.estop import EstopClient
from bosdyn.client.power import PowerClient
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient

from fake_robot.start.process import FakeAddress, FakeProcess
from proof.bench_signals import ending_the_bench
from proof.faults.drive import Drive, read_log
from proof.faults.faulty_hal import FaultyHal, When
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.sink import LogSink
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import rotation
from spot_protos import fake_admin_pb2, fake_admin_pb2_grpc
from spot_runtime.config import RobotConfig, RunConfig, for_lock_step
from spot_runtime.hal.base import Hal
from spot_runtime.hal.connection.address import Address, parse_address
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.pace import Pace
from spot_runtime.hal.spot.session import Session
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from spot_runtime.host.console import Console
from spot_runtime.session.run import RunRequest, SinkFactory, run
from spot_runtime.sources.base import CommandSource
from spot_tools.run.scripted import ScriptedSource

CALM: Final[Mapping[str, Mapping[str, Any]]] = {
    "real_time": {"fifo_priority": 0, "lock_memory": False, "freeze_garbage_collection": False},
    "handover": {
        "ramp_in_s": 0.3,
        "settle_s": 0.3,
        "ramp_out_s": 0.4,
        "soft_stop_s": 0.4,
        "soft_stop_settle_s": 0.3,
        "damping_s": 1.0,
    },
}
"""A configuration that is quick to move, and leaves the settings of the measuring process alone."""

WALKING: Final = VelocitySequence(name="fault", duration_s=600.0, waypoints=(Waypoint(time_s=0.0, v_x_m_s=0.4),))
OVERTURNED_RAD: Final = 0.5
RUN_PRIORITY: Final = 40
FAKE_PRIORITY: Final = 35
"""In real time; a real robot computes elsewhere, so the fake must not wait for other work of this computer."""

AT_S: Final = 0.8
"""When it happens, robot time since joint control began: the policy is in full control and the robot walks."""


@dataclass
class Rig:
    """A fake robot in lock-step or real time, with the means to drive and break it."""

    address: FakeAddress
    admin: Any
    folder: Path
    policy: Policy
    policy_file: Path
    is_lock_step: bool = True
    calm: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: CALM)
    """What every run's configuration begins with."""
    make_sink: SinkFactory = LoggerProcess.start
    """Opens the log of a run."""
    _count: int = field(default=0)
    estops: tuple[str, ...] = ()
    """Who held the robot's e-stop before the first run."""

    # The robot -------------------------------------------------------------------------------------------------------

    def inject(self, name: str, lasts_s: float = 0.0, /, **parameters: float | str) -> None:
        """Make a fault of the fake robot happen now; 0 s: until it is cleared."""
        numbers = {k: v for k, v in parameters.items() if isinstance(v, float)}
        texts = {k: v for k, v in parameters.items() if isinstance(v, str)}
        request = fake_admin_pb2.InjectFaultRequest(name=name, numbers=numbers, texts=texts, duration_s=lasts_s)
        self.admin.InjectFault(request)

    def clear(self) -> None:
        """End all faults."""
        self.admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest())

    def status(self) -> Any:
        """The robot's mode, power, owner and counters."""
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    def truth(self, *, reset_extremes: bool = False) -> Any:
        """The simulated body as it is."""
        return self.admin.GetTruth(fake_admin_pb2.GetTruthRequest(reset_extremes=reset_extremes))

    def step(self, seconds: float, part_s: float = 0.05) -> None:
        """Let robot time pass."""
        if not self.is_lock_step:
            time.sleep(seconds)
            return
        for _ in range(round(seconds / part_s)):
            self.admin.Step(fake_admin_pb2.StepRequest(duration_ns=round(part_s * 1e9)))

    def clear_behavior_faults(self) -> tuple[str, ...]:
        """As a person with a tablet does. Returns who holds the e-stop. Raises HalError: the robot is not reached."""
        return clear_behavior_faults(self.address.robot, self.config().robot)

    def restore(self) -> str:
        """After a run: no faults, no behaviour faults and nobody's lease, as a person with a tablet would leave it.

        Returns:
            What is left that the next run would suffer from, in words; nothing where the robot is good again.
        """
        self.clear()
        if self.status().lease_owner:
            self.inject("lease_expired")
        self.step(0.3)
        with self.environment():
            estops = self.clear_behavior_faults()
            if tilt_rad(self.truth()) > OVERTURNED_RAD:
                turn_over(self)
        return self._left(estops)

    def _left(self, estops: tuple[str, ...]) -> str:
        status = self.status()
        left = [f"the fault {fault.name}" for fault in status.active_faults]
        if status.estop_level.lower() not in ("none", "estop_level_none"):
            left.append(f"an e-stop at {status.estop_level}")
        if estops != self.estops:
            left.append(f"the e-stop in the hands of {', '.join(estops) or 'nobody'}")
        if not status.motor_power.lower().endswith("off"):
            left.append(f"motors {status.motor_power}")
        if status.lease_owner:
            left.append(f"the lease with {status.lease_owner}")
        return ", ".join(left)

    # Runs ------------------------------------------------------------------------------------------------------------

    def config(self, **changes: Mapping[str, Any]) -> RunConfig:
        """The configuration of a run: :attr:`calm`, with these parts changed."""
        parts: dict[str, Any] = {name: dict(part) for name, part in self.calm.items()}
        parts["robot"] = {"ca_file": str(self.address.ca_file)}
        for name, part in changes.items():
            parts[name] = {**parts.get(name, {}), **part}
        if not self.is_lock_step:
            parts["real_time"] = {**parts["real_time"], "fifo_priority": RUN_PRIORITY}
        config = RunConfig.model_validate(parts)
        return for_lock_step(config) if self.is_lock_step else config

    def new_log_path(self) -> Path:
        """A name that no log has."""
        self._count += 1
        return self.folder / f"run{self._count}.mcap"

    def drive(
        self,
        happens: Callable[[FaultyHal], None] = lambda _: None,
        *,
        at_s: float = AT_S,
        when: When = "control",
        seconds: float = 3.0,
        source: CommandSource | None = None,
        policy: Policy | None = None,
        make_sink: SinkFactory | None = None,
        make_faulty: Callable[[Address, RunConfig, LogSink, Pace | None], FaultyHal] = FaultyHal,
        **changes: Mapping[str, Any],
    ) -> Drive:
        """One run; ``happens`` is called once, ``at_s`` of robot time after joint control (or ``when``) began."""
        config, path = self.config(**changes), self.new_log_path()
        wanted = source or ScriptedSource(WALKING, duration_s=seconds)
        request = RunRequest(self.address.robot, policy or self.policy, wanted, config, path)
        meddlers: list[FaultyHal] = []

        def make_hal(sink: LogSink) -> Hal:
            hal = make_faulty(parse_address(self.address.robot), config, sink, self._pace())
            hal.prepare(self, happens, at_s, when)
            meddlers.append(hal)
            return hal

        console = Console(io.StringIO())
        with self.environment(), ending_the_bench():
            try:
                summary = run(request, make_hal, make_sink or self.make_sink, console)
            finally:
                console.close()
        log, problem = read_log(path)
        happened = meddlers[0] if meddlers else None
        return Drive(
            summary,
            log,
            path,
            0 if happened is None else happened.happened_ns,
            0 if happened is None else happened.power_off_ns,
            problem,
            None if happened is None else happened.truth,
            happened is not None and happened.was_off,
        )

    def _pace(self) -> LockStep | None:
        return LockStep(self.address.admin, HostClock().now_ns(), every_state=True) if self.is_lock_step else None

    @contextmanager
    def environment(self) -> Iterator[None]:
        """With user name and password in the environment."""
        before = dict(os.environ)
        os.environ.update(self.address.environment)
        try:
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)


def clear_behavior_faults(robot: str, config: RobotConfig) -> tuple[str, ...]:
    """Do by hand what the runtime never does by itself. Returns who holds the e-stop. Raises HalError."""
    clock = HostClock()
    session = Session(parse_address(robot), config, clock, RobotClockEstimate(), clock.now_ns)
    try:
        session.log_in()
        numbers = [int(text.rpartition("(")[2].rstrip(")")) for text in session.poll().behavior_faults]
        if numbers:
            session.sync_clocks()
            session.acquire_lease()
        client = session.calls.client(RobotCommandClient)
        for number in numbers:
            session.calls.make("clearing a fault", partial(client.clear_behavior_fault, number))
        status = session.calls.make("asking for the e-stop", session.calls.client(EstopClient).get_status)
        return tuple(endpoint.endpoint.name for endpoint in status.endpoints)
    finally:
        session.close()


def tilt_rad(truth: Any) -> float:
    """How far the body leans."""
    return float(rotation.tilt_rad(np.array(truth.world_from_body_wxyz)))


def turn_over(robot: Rig) -> None:
    """Set the robot upright by the vendor's own motion. Raises HalError."""
    clock, config = HostClock(), robot.config().robot
    session = Session(parse_address(robot.address.robot), config, clock, RobotClockEstimate(), clock.now_ns)
    try:
        session.log_in()
        session.sync_clocks()
        session.acquire_lease()
        power, command = session.calls.client(PowerClient), session.calls.client(RobotCommandClient)
        request = power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS
        session.calls.make("powering on", lambda: power.power_command(request))
        robot.step(2.5)
        for wanted in (RobotCommandBuilder.selfright_command(), RobotCommandBuilder.safe_power_off_command()):
            session.calls.make("turning over", partial(command.robot_command, wanted))
            robot.step(4.0)
    finally:
        session.close()


@contextmanager
def rig(folder: Path, policy_file: Path, *, is_lock_step: bool = True, scenario: str = "default") -> Iterator[Rig]:
    """A fake robot in a process of its own, for a while."""
    folder.mkdir(parents=True, exist_ok=True)
    with (
        FakeProcess(
            scenario=scenario,
            is_lock_step=is_lock_step,
            fifo_priority=0 if is_lock_step else FAKE_PRIORITY,
            state_dir=folder / "state",
        ) as process,
        grpc.insecure_channel(process.address.admin) as channel,
    ):
        admin = fake_admin_pb2_grpc.FakeAdminStub(channel)  # type: ignore[no-untyped-call]
        robot = Rig(process.address, admin, folder, load_policy(policy_file), policy_file, is_lock_step)
        with robot.environment():
            robot.estops = robot.clear_behavior_faults()
        yield robot
