"""Runs against a fake robot to which something happens at a chosen instant of robot time, and their logs."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import grpc

from fake_robot.start.process import FakeProcess
from proof.faulty import FaultyHal, FaultyPolicy, When
from proof.robot import FakeRobot
from spot_log import LogReadError, Run, read_run
from spot_log.format.records import RunHeader
from spot_log.write.flight_recorder import flight_record_path
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.run_writer import active_path
from spot_log.write.sink import LogSink
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.policy.policy import Policy, load_policy
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub
from spot_runtime.config import RunConfig, for_lock_step
from spot_runtime.hal.base import Hal
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.pace import Pace
from spot_runtime.host.clock import HostClock
from spot_runtime.host.journal import Console
from spot_runtime.session.run import RunRequest, SinkFactory, run_once
from spot_runtime.session.summary import RunSummary
from spot_runtime.sources import CommandSource
from spot_tools.sources import ScriptedSource

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
RUN_PRIORITY: Final = 40
FAKE_PRIORITY: Final = 35
"""In real time; a real robot computes elsewhere, so the fake must not wait for other work of this computer."""

AT_S: Final = 0.8
"""When it happens, robot time since joint control began: the policy is in full control and the robot walks."""

HalMaker = Callable[[FakeRobot, RunConfig, LogSink, Pace | None], FaultyHal]


@dataclass
class Drive:
    """What one run was, and what is known of it."""

    summary: RunSummary
    hal: FaultyHal
    log_path: Path

    @cached_property
    def opened(self) -> tuple[Run | None, str]:
        """The log, whole or as a crash left it, and why it does not open."""
        return read_log(self.log_path)

    @property
    def log(self) -> Run:
        """The log. Raises LogReadError where it does not open."""
        log, problem = self.opened
        if log is None:
            raise LogReadError(problem)
        return log

    @property
    def happened_ns(self) -> int:
        """Robot clock when it happened; 0 if it never did."""
        return self.hal.happened_ns

    @property
    def incident(self) -> Run | None:
        """The incident file; None where there is none."""
        path = flight_record_path(self.log_path)
        return read_run(path) if path.exists() else None

    def event_ns(self, text: str) -> int | None:
        """Robot stamp of the first event after it happened whose name or text ends like this."""
        for event in self.log.events:
            is_it = event.name == text or event.text.endswith(f"→ {text}")
            if is_it and event.robot_stamp_ns >= self.happened_ns:
                return event.robot_stamp_ns
        return None


@dataclass
class Rig(FakeRobot):
    """A fake robot, and runs on it."""

    folder: Path
    policy_file: Path
    policy: FaultyPolicy
    calm: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: CALM)
    """What every run's configuration begins with."""
    wakes_at_every_state: bool = True
    """In lock-step, as in real time; otherwise only where a tick is due, which is quicker."""
    make_sink: SinkFactory | None = None
    """What opens the log of a run that names nothing else; None: the log's own process, as in a real run."""
    loggers: list[LoggerProcess] = field(default_factory=list)
    """The log's process of each run, oldest first."""
    _names: int = 0

    def config(self, **changes: Mapping[str, Any]) -> RunConfig:
        """The configuration of a run: :attr:`calm`, with these parts changed."""
        parts: dict[str, Any] = {name: dict(part) for name, part in self.calm.items()}
        parts["robot"] = self.robot_config.model_dump()
        for name, part in changes.items():
            parts[name] = {**parts.get(name, {}), **part}
        if not self.is_lock_step:
            parts["real_time"] = {**parts["real_time"], "fifo_priority": RUN_PRIORITY}
        config = RunConfig.model_validate(parts)
        return for_lock_step(config) if self.is_lock_step else config

    def new_log_path(self) -> Path:
        """A name that no log has."""
        self._names += 1
        return self.folder / f"run{self._names}.mcap"

    def start_logger(self, path: Path, header: RunHeader) -> LogSink:
        """Start the log's process, as a run does."""
        self.loggers.append(LoggerProcess.start(path, header))
        return self.loggers[-1]

    def drive(
        self,
        happens: Callable[[FaultyHal], object] = lambda _: None,
        *,
        at_s: float = AT_S,
        when: When = "control",
        seconds: float = 2.0,
        source: CommandSource | None = None,
        policy: Policy | None = None,
        log_path: Path | None = None,
        make_sink: SinkFactory | None = None,
        make_faulty: HalMaker = FaultyHal,
        **changes: Mapping[str, Any],
    ) -> Drive:
        """Make one run; ``happens`` is called once, ``at_s`` of robot time after joint control (or ``when``) began."""
        config, path = self.config(**changes), log_path or self.new_log_path()
        wanted = source or ScriptedSource(WALKING, duration_s=seconds)
        self.policy.change.act = None
        request = RunRequest(self.address.robot, policy or self.policy, wanted, config, path)
        made: list[FaultyHal] = []

        def make_hal(sink: LogSink) -> Hal:
            made.append(make_faulty(self, config, sink, self._pace()))
            made[0].prepare(happens, at_s, when)
            return made[0]

        console = Console(io.StringIO())
        try:
            summary = run_once(request, make_hal, make_sink or self.make_sink or self.start_logger, console)
        finally:
            console.close()
        return Drive(summary, made[0], path)

    def _pace(self) -> Pace | None:
        if not self.is_lock_step:
            return None
        return LockStep(self.address.admin, HostClock().now_ns(), every_state=self.wakes_at_every_state)


def read_log(path: Path) -> tuple[Run | None, str]:
    """Read the log, whole or as a crash left it. Returns it, or why it does not open."""
    for candidate in (path, active_path(path)):
        if candidate.exists():
            try:
                return read_run(candidate), ""
            except (LogReadError, OSError) as error:
                return None, str(error)
    return None, f"there is no {path}"


@contextmanager
def rig(folder: Path, policy_file: Path, *, is_lock_step: bool = True, scenario: str = "default") -> Iterator[Rig]:
    """Run a fake robot in a process of its own, for a while; its keys, password and logs go to ``folder``."""
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
        admin = stub(channel, fake_admin_pb2)
        variables, credentials = process.address.environment, folder / "credentials"
        user = {"username": variables["BOSDYN_CLIENT_USERNAME"], "password": variables["BOSDYN_CLIENT_PASSWORD"]}
        credentials.touch(mode=0o600)
        credentials.write_text(json.dumps(user), encoding="utf-8")  # JSON is YAML
        policy = FaultyPolicy.of(load_policy(policy_file))
        robot = Rig(process.address, admin, credentials, is_lock_step, (), folder, policy_file, policy)
        robot.estops = robot.clear_behavior_faults()
        yield robot
