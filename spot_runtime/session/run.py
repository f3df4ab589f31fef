"""One run from the first call to the robot to the closed log."""

from __future__ import annotations

import contextlib
import math
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

from spot_log import recover_leftovers
from spot_log.format.events import EventName
from spot_log.format.records import EventRecord, RunHeader
from spot_log.write.flight_recorder import FlightRecorder
from spot_log.write.sink import LogSink
from spot_model.policy.joint_script import JointScript
from spot_model.policy.policy import Policy
from spot_model.version import software_revision, software_version
from spot_runtime.admission import gait_event
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.loop_stats import LoopStats
from spot_runtime.control.memory import NOTHING_ASKED
from spot_runtime.hal.base import Hal
from spot_runtime.host.clock import HostClock
from spot_runtime.host.journal import Console
from spot_runtime.host.pauses import pauses
from spot_runtime.host.realtime import apply_real_time, freeze_garbage_collection
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.session.robot_session import ControlEnd, RobotSession, control_end
from spot_runtime.session.signals import StopSignals
from spot_runtime.session.summary import RunSummary, figures, resident_mb
from spot_runtime.sources import CommandSource
from spot_runtime.stops import WANTED_ENDS, StopReason


@dataclass(frozen=True)
class RunRequest:
    """What one run is made of."""

    robot: str
    """The robot's address, as given."""
    policy: Policy
    source: CommandSource
    config: RunConfig
    log_path: Path
    repeat: int = 0
    labels: dict[str, str] = field(default_factory=dict)


RECORD_TIMEOUT_S: Final = 5.0
"""Longest wait for an incident file, once the robot is at rest."""

HalFactory = Callable[[LogSink], Hal]
SinkFactory = Callable[[Path, RunHeader], LogSink]
TellEvent = Callable[[EventRecord], None]


def log_header(request: RunRequest, started_host_stamp_ns: int) -> RunHeader:
    """The log's header: all that tells this run from others."""
    contract = request.policy.contract
    return RunHeader(
        run_id=uuid.uuid4().hex,
        started_host_stamp_ns=started_host_stamp_ns,
        robot_id=request.robot,
        adapter=request.config.robot.hal,
        policy_name=contract.name,
        policy_sha256=request.policy.sha256,
        policy_contract_json="" if isinstance(request.policy, JointScript) else contract.to_json(),
        config_json=request.config.to_json(),
        command_sequence=request.source.name,
        repeat=request.repeat,
        labels={**request.config.log.labels, **request.labels},
        software_version=software_version(),
        software_revision=software_revision(),
    )


def log_file_name(policy_name: str, sequence: str, repeat: int, now: datetime | None = None) -> str:
    """A name that sorts by time and says what ran."""
    now = now or datetime.now(timezone.utc)
    words = [now.strftime("%Y%m%d-%H%M%S"), policy_name, sequence, f"r{repeat}"]
    safe = ["".join(c if c.isalnum() or c in "-_." else "_" for c in word) for word in words]
    return "-".join(safe) + ".mcap"


def recover_at_start(directory: Path, console: Console) -> None:
    """Repair what a crash has left behind; a run starts even if that fails."""
    try:
        for recovery in recover_leftovers(directory):
            console.say(f"{recovery.result}: recovered from a run that did not end cleanly")
    except OSError as error:
        console.say(f"warning: leftovers in {directory} could not be recovered: {error.strerror or error}")


def run_once(
    request: RunRequest,
    make_hal: HalFactory,
    make_sink: SinkFactory,
    console: Console,
    *,
    manager: ServiceManager | None = None,
    tell: TellEvent | None = None,
) -> RunSummary:
    """Drive the robot through one run; it ends at rest and without power, or the summary says why not.

    ``manager`` is told of readiness, progress and the end; ``tell`` takes events in the console's place, and must not
    block.

    Raises:
        SpotRlError: The log cannot be opened. Whatever happens later is in the summary, and in the log.
    """
    header = log_header(request, HostClock().now_ns())
    sink = FlightRecorder(make_sink(request.log_path, header), WANTED_ENDS)
    attempt = _Attempt(request, header, sink, console, manager, tell or console.event)
    with attempt.signals:
        try:
            attempt.drive(make_hal)
        finally:
            console.show(None)
            request.source.close()
            sink.close(attempt.session.outcome.label or StopReason.INTERNAL_ERROR.label)
    return attempt.summary()


class Driver:
    """Drives one robot through its session: what a single run and an operator's arming have in common."""

    def __init__(
        self, config: RunConfig, sink: LogSink, tell: TellEvent, manager: ServiceManager | None = None, sender: str = ""
    ) -> None:
        self.config, self.sink, self.manager = config, sink, manager or ServiceManager()
        self._tell, self._clock, self.signals = tell, HostClock(), StopSignals(sender)
        self.session = RobotSession(
            self.signals, self.event, limits=config.safety, say=self.say, on_shut_down=self.shutting_down
        )

    def say(self, text: str) -> None:
        """Words about progress."""

    def shutting_down(self) -> None:
        """The robot is brought to rest from now on."""

    def ask_for_real_time(self) -> tuple[str, ...]:
        """Apply the real-time settings. Returns what the system refuses, which is told."""
        refusals = tuple(apply_real_time(self.config.real_time))
        for refusal in refusals:
            self.event(EventName.REAL_TIME_REFUSED, refusal)
        return refusals

    def make(self, make_hal: HalFactory, policy: Policy) -> Hal:
        """The adapter. What takes long is done first: later the robot has power, and nobody would look after it."""
        policy.warm_up()
        return make_hal(self.sink)

    def loop_of(self, hal: Hal, policy: Policy, source: CommandSource) -> ControlLoop:
        """The loop of a control that begins now."""
        watch = pauses(self.config.real_time)
        loop = ControlLoop(hal, policy, source, self.config, self.sink, on_event=self._tell, pauses=watch)
        freeze_garbage_collection(self.config.real_time)
        return loop

    def event(self, name: EventName, text: str) -> None:
        """Write an event to the log of the moment, and tell of it."""
        record = EventRecord(self.now_ns(), 0, name.severity, name.label, text)
        self.sink.put(record)
        self._tell(record)

    def now_ns(self) -> int:
        """The host's clock, as the adapter has it once there is one."""
        hal = self.session.hal
        return self._clock.now_ns() if hal is None else hal.host_now_ns()


class _Attempt(Driver):
    """The steps of one run, and what is known of its end."""

    def __init__(
        self,
        request: RunRequest,
        header: RunHeader,
        sink: FlightRecorder,
        console: Console,
        manager: ServiceManager | None,
        tell: TellEvent,
    ) -> None:
        super().__init__(request.config, sink, tell, manager)
        self._request, self._header, self._flight, self._console = request, header, sink, console
        self._loop: ControlLoop | None = None
        self._stats = LoopStats()
        self._refusals: tuple[str, ...] = ()
        self._recorders: list[threading.Thread] = []
        self._recorded: tuple[EventName, str] | None = None
        self._control_s = (0.0, 0.0)
        self._rss_start_mb = resident_mb()

    def drive(self, make_hal: HalFactory) -> None:
        """Connect, stand, control, sit, power off."""
        policy = self._request.policy
        if isinstance(policy, JointScript):
            self.event(EventName.RUN_STARTED, f"joint experiment {policy.contract.name}, {policy.experiment.kind}")
        else:
            self.event(EventName.RUN_STARTED, f"policy {policy.contract.name}, {self._request.source.name}")
            event, told = gait_event(policy.contract)
            self.event(event, told)
            self.manager.status(told)
        self._refusals = self.ask_for_real_time()
        self.say(f"connecting to {self._request.robot} …")
        try:
            self.session.drive(lambda: self.make(make_hal, policy), self._control)
        finally:
            self._record_flight(RECORD_TIMEOUT_S)
            if self._recorded is not None:
                self.event(*self._recorded)

    def summary(self) -> RunSummary:
        """What a person and a program want to know."""
        rss_mb = resident_mb()
        health, outcome = self._flight.health(), self.session.outcome
        if health.path == "":
            outcome = outcome.after_loss_of_log(health.problem)
        return RunSummary(
            outcome=outcome.label,
            exit_code=outcome.exit_code,
            sentence=outcome.sentence,
            log_path=str(self._request.log_path) if health.path is None else health.path,
            log_dropped=sum(health.dropped.values()),
            log_unwritten=sum(health.unwritten.values()),
            log_problem=health.problem,
            states_missed=0 if self._loop is None else self._loop.missed_states,
            rss_mb=rss_mb,
            rss_growth_mb=rss_mb - self._rss_start_mb,
            control_robot_s=self._control_s[0],
            control_wall_s=self._control_s[1],
            real_time_refusals=self._refusals,
            **figures(self._stats),  # type: ignore[arg-type]
        )

    def _control(self, hal: Hal) -> ControlEnd:
        loop = self._loop = self.loop_of(hal, self._request.policy, self._request.source)
        self._stats = loop.stats
        self._console.show(lambda: self._show(_progress(loop)))
        self._rss_start_mb = resident_mb()
        self.manager.ready()
        began_robot_ns, began_s = hal.robot_now_ns(), time.monotonic()
        while not loop.is_done:
            asked = self.signals.take()
            if asked is not None:
                loop.ask_stop(asked)
            loop.cycle()
            self.manager.progressed()
        self._control_s = (hal.robot_now_ns() - began_robot_ns) / 1e9, time.monotonic() - began_s
        self._console.show(None)
        return control_end(loop.ending)

    def shutting_down(self) -> None:
        """Write what led here, and say so."""
        self.manager.stopping()
        self._record_flight(0.0)
        self.say("sitting and powering off …")

    def _record_flight(self, within_s: float) -> None:
        """Write what led to a stop, in a thread of its own: a slow disk must not keep the robot standing."""
        path, header, label = self._request.log_path, self._header, self.session.outcome.label

        def write() -> None:
            told = self._flight.write(path, header, label)
            self._recorded = told or self._recorded

        with contextlib.suppress(RuntimeError):  # there is no room for another thread
            recorder = threading.Thread(target=write, name="flight record", daemon=True)
            recorder.start()
            self._recorders.append(recorder)
        for recorder in self._recorders:
            recorder.join(within_s)

    def say(self, text: str) -> None:
        """To the service manager and the console."""
        self.manager.status(text)
        self._console.say(text)

    def _show(self, progress: str) -> str:
        """The progress line where a person reads along; a service manager shows it itself, so that no log fills."""
        if not self.manager.is_listening:
            return progress
        self.manager.status(progress)
        return ""


def _progress(loop: ControlLoop) -> str:
    status, stats = loop.status, loop.stats
    if math.isnan(stats.rate_hz):
        return str(status.mode.value)  # no tick yet
    return (
        f"{status.mode.value:<11} {status.active_s:6.1f} s  {_in_words(status.command.tolist())}  "
        f"{stats.rate_hz:6.2f} Hz  age p99 {stats.state_age_s.percentile(99) * 1e3:.1f} ms  "
        f"tick p50 {stats.compute_s.percentile(50) * 1e6:.0f} µs  skipped {stats.skipped_ticks}"
    )


def _in_words(command: list[float]) -> str:
    if len(command) == len(NOTHING_ASKED):
        v_x, v_y, yaw = command
        return f"command {v_x:+.2f} {v_y:+.2f} m/s {yaw:+.2f} rad/s"
    return f"set-points up to {max(map(abs, command)):.2f} rad from rest"
