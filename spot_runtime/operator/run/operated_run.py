"""One arming of a robot, from the lease to power off: the vendor's controller stands, and the policy walks when asked.

    connect ──► stand ──► standing by ◄──► control ──► sit, power off
                              (each control is one log)

One thread does all of it. Whatever an operator asks comes through the link, a few messages a cycle; whatever goes wrong
ends at rest. When nobody attends any more, or the operator's service is gone, the robot stops in place, sits and powers
off.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord, RunHeader
from spot_log.write.sink import LogSink
from spot_model.errors import SpotRlError
from spot_model.policy.policy import Policy
from spot_model.robot.state import RobotState
from spot_protos import operator_pb2
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.stops import Reaction, Stop, StopReason
from spot_runtime.control.tick import warm_up
from spot_runtime.hal.base import Hal
from spot_runtime.hal.errors import HalError
from spot_runtime.host.clock import HostClock
from spot_runtime.host.realtime import apply_real_time, freeze_garbage_collection
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.run.background_tasks import Errands
from spot_runtime.operator.run.link import RunLink
from spot_runtime.operator.run.requests import Requests
from spot_runtime.operator.run.run_logs import LogDesk, SwitchedSink
from spot_runtime.operator.run.run_spec import RunSpec
from spot_runtime.operator.run.run_status import STATUS_PERIOD_NS, status_of
from spot_runtime.operator.run.standby import check_standing
from spot_runtime.operator.run.steering import Attendance, OperatorSource
from spot_runtime.session.run import MEANT_WELL, RunRequest, header_of, log_file_name
from spot_runtime.session.signals import OperatorInterrupt, StopSignals

HalFactory = Callable[[LogSink], Hal]
SinkFactory = Callable[[Path, RunHeader], LogSink]
STANDBY_WAIT_S: Final = 0.02
LOCK_STEP_PAUSE_S: Final = 0.002
"""In lock-step robot time would otherwise race while a person thinks."""


class OperatedRun:
    """Everything between an operator's Arm and the robot at rest."""

    def __init__(
        self, spec: RunSpec, policy: Policy, link: RunLink, make_sink: SinkFactory, *, manager: ServiceManager | None
    ) -> None:
        """Prepare.

        Args:
            spec: What to run.
            policy: The one that ``spec`` names, loaded.
            link: To the operator's service.
            make_sink: Opens a log.
            manager: Told of progress while this process is answerable for the robot; nobody if None.
        """
        self._spec, self._config, self._link = spec, spec.config, link
        self._manager = manager or ServiceManager()
        self._clock = HostClock()
        self._sink = SwitchedSink()
        self._desk = LogDesk(make_sink, self._sink)
        self._source = OperatorSource(spec.config)
        self._requests = Requests(self)
        self._errands = Errands(is_sync=bool(spec.lock_step))
        self.policy = policy
        self.attendance = Attendance(spec.config, self._clock.now_ns())
        self.loop: ControlLoop | None = None
        self.stop: Stop | None = None
        """Why the whole arming ends; None while it goes on."""
        self.keeps_standing = False
        """Whether the robot goes on standing by after the control that ends now."""
        self.is_start_asked = False
        self._hal: Hal | None = None
        self._robot_id = ""
        self._status_due_ns = 0
        self._status_ticks = -1
        self._outcome, self._exit_code, self._sentence = "internal_error", StopReason.INTERNAL_ERROR.exit_code, ""

    def drive(self, make_hal: HalFactory) -> operator_pb2.Outcome:
        """Do it all. Returns how it ended, which is also told to the service."""
        with StopSignals() as signals:
            try:
                self._drive(make_hal, signals)
            finally:
                self._end_log(None)
        outcome = operator_pb2.Outcome(
            outcome=self._outcome,
            exit_code=self._exit_code,
            sentence=self._sentence,
            log_paths=[str(path) for path in self._desk.paths],
            host_stamp_ns=self._clock.now_ns(),
        )
        self._link.ended(outcome)
        return outcome

    # What requests use ------------------------------------------------------------------------------------------------

    @property
    def link(self) -> RunLink:
        """To the operator's service."""
        return self._link

    @property
    def source(self) -> OperatorSource:
        """Where velocities go."""
        return self._source

    @property
    def errands(self) -> Errands:
        """What takes long and must not hold up the robot's cycles."""
        return self._errands

    @property
    def config(self) -> RunConfig:
        """Of the run: where policies are computed, and which may run."""
        return self._config

    @property
    def log_path(self) -> str:
        """The log that is being written; empty: none."""
        return "" if self._desk.path is None else str(self._desk.path)

    def end(self, stop: Stop) -> None:
        """End the arming, or the control that is under way and then the arming."""
        self.keeps_standing = False
        if self.loop is not None:
            self.loop.ask_stop(stop)
        elif self.stop is None:
            self.stop = stop
            if stop.reason.reaction is Reaction.ESTOP and self._hal is not None:
                self._hal.estop()
            self.event(EventName.STOP, f"{stop.reason.label}: {stop.sentence()}")

    def begin_log(self, labels: dict[str, str]) -> Path:
        """Open a log. Raises LogError."""
        request = self._request(labels)
        path = self._desk.begin(request.log_path, header_of(request, self._now_ns()))
        self.event(EventName.RUN_STARTED, f"policy {self.policy.contract.name}, {request.source.name}")
        return path

    def event(self, name: EventName, text: str) -> None:
        """Write an event to the log of the moment, and tell the service."""
        record = EventRecord(self._now_ns(), 0, name.severity, name.label, text)
        self._sink.event(record)
        self._link.event(record)

    # The way through --------------------------------------------------------------------------------------------------

    def _drive(self, make_hal: HalFactory, signals: StopSignals) -> None:
        try:
            self._arm_and_serve(make_hal, signals)
        except OperatorInterrupt as interrupt:
            self._end(interrupt.stop)
            self.event(EventName.STOP, interrupt.stop.sentence())
            self._try_power_off(signals, interrupt.stop)
        finally:
            signals.interrupts = False
            if self._hal is not None:
                self._hal.close()

    def _arm_and_serve(self, make_hal: HalFactory, signals: StopSignals) -> None:
        """All of it, and what answers an error. An interrupt may come at any point, also while an error is answered."""
        try:
            for refusal in apply_real_time(self._config.real_time):
                self.event(EventName.REAL_TIME_REFUSED, refusal)
            signals.interrupt_waits()
            hal = self._hal = make_hal(self._sink)
            self._connect(hal)
            signals.interrupts = False
            stop = self._serve(hal, signals)
            self._end(stop)
            signals.interrupt_waits()
            self._rest(hal, stop)
        except HalError as error:
            self._outcome, self._exit_code, self._sentence = error.label, error.exit_code, str(error)
            self.event(EventName.CONNECTION_FAILED, str(error))
            self._try_power_off(signals)
        except Exception as error:  # noqa: BLE001 - a defect here must not leave the robot standing with power
            self._end(Stop(StopReason.INTERNAL_ERROR, f"{type(error).__name__}: {error}"))
            self.event(EventName.STOP, f"{StopReason.INTERNAL_ERROR.label}: {self._sentence}")
            self._try_power_off(signals)

    def _connect(self, hal: Hal) -> None:
        info = hal.connect()
        self._robot_id = info.robot_id
        round_trip_ms = info.round_trip_s * 1e3
        text = f"{info.robot_id}; clock {info.clock_skew_s:+.3f} s from ours, round trip {round_trip_ms:.1f} ms"
        self.event(EventName.CONNECTED, text)
        hal.stand()
        warm_up(self.policy)
        self.attendance = Attendance(self._config, hal.host_now_ns())
        self.event(EventName.ARMED, f"policy {self.policy.contract.name}")
        self._tell_armed()

    def _serve(self, hal: Hal, signals: StopSignals) -> Stop:
        """Stand by and control in turn, until something ends it."""
        while True:
            stop = self._stand_by(hal, signals)
            if stop is not None:
                self._link.state("ending")
                return stop
            stop = self._control(hal, signals)
            keeps = self.keeps_standing and stop.reason is StopReason.OPERATOR_STOP
            self._link.state("arming" if keeps else "ending")
            self._end_log(stop)
            if not keeps:
                return stop
            hal.stand()
            self._tell_armed()

    def _stand_by(self, hal: Hal, signals: StopSignals) -> Stop | None:
        """Until a start is asked for (None), or the end."""
        self.stop, self.is_start_asked = None, False
        newest_ns = hal.host_now_ns()
        while self._waits():
            states = hal.receive(0, STANDBY_WAIT_S)
            newest_ns = states[-1].host_stamp_ns if states else newest_ns
            self._look(signals)
            wrong = check_standing(hal, newest_ns, self._config.safety)
            if wrong is not None:
                self.end(wrong)
            self._errands.finish()
            self._tell_status(hal, states[-1] if states else None)
            self._manager.progressed()
            if self._spec.lock_step:
                time.sleep(LOCK_STEP_PAUSE_S)
        return self.stop

    def _waits(self) -> bool:
        return self._errands.is_busy or (self.stop is None and not self.is_start_asked)

    def _control(self, hal: Hal, signals: StopSignals) -> Stop:
        self.keeps_standing = False
        self._source.let_go()
        loop = ControlLoop(hal, self.policy, self._source, self._config, self._sink, on_event=self._link.event)
        freeze_garbage_collection(self._config.real_time)
        self.loop, self._status_ticks = loop, -1
        self._link.state("running")
        try:
            while not loop.is_done:
                self._look(signals)
                loop.cycle()
                if loop.stats.ticks != self._status_ticks:  # the longest pause until the next tick begins now
                    self._status_ticks = loop.stats.ticks
                    self._tell_status(hal, loop.newest)
                self._manager.progressed()
        finally:
            self.loop = None
        return loop.stop or Stop(StopReason.COMPLETED)

    def _look(self, signals: StopSignals) -> None:
        """Take what operators and signals want, and see whether anybody is there."""
        now_ns = self._now_ns()
        for message in self._link.take():
            self.attendance.seen(now_ns)
            self._requests.handle(message, now_ns)
        asked = signals.take()
        if asked is not None:
            self.end(asked)
        if self._link.is_lost:
            self.end(Stop(StopReason.SERVICE_LOST))
        gone = self.attendance.check(now_ns)
        if gone is not None:
            self.end(gone)

    # Ends -------------------------------------------------------------------------------------------------------------

    def _end(self, stop: Stop) -> None:
        self._outcome, self._exit_code, self._sentence = stop.reason.label, stop.reason.exit_code, stop.sentence()

    def _rest(self, hal: Hal, stop: Stop) -> None:
        if stop.reason.reaction is Reaction.HAND_BACK and self.stop is None and not stop.reason.is_urgent:
            try:
                hal.stand()
            except HalError as error:
                self.event(EventName.STAND_FAILED, f"{error}; it sits down as it is")
        if self._is_powered_off(hal):
            self.event(EventName.POWER_OFF, "the robot sits and its motors are off")

    def _try_power_off(self, signals: StopSignals, stop: Stop | None = None) -> None:
        self._link.state("ending")
        if self._hal is None:
            return
        try:
            if stop is not None and stop.reason.reaction is Reaction.ESTOP:
                self._hal.estop()
            else:
                signals.interrupt_waits(only_estop=True)
            self._is_powered_off(self._hal)
        except OperatorInterrupt as interrupt:
            self._end(interrupt.stop)
            self.event(EventName.STOP, interrupt.stop.sentence())
            self._try_power_off(signals, interrupt.stop)

    def _is_powered_off(self, hal: Hal) -> bool:
        """Power off; where that fails, the words about the end say so, and no exit code that means well is left."""
        try:
            hal.power_off()
        except HalError as error:
            self.event(EventName.POWER_OFF_FAILED, f"{error}; see to the robot")
            self._sentence = f"{self._sentence}; then powering off failed: {error}; see to the robot"
            if self._exit_code in MEANT_WELL:
                self._outcome, self._exit_code = "power_off_failed", error.exit_code
            return False
        return True

    def _end_log(self, stop: Stop | None) -> None:
        """Close the log; where something went wrong, write what led to it first."""
        label = self._outcome if stop is None else stop.reason.label
        try:
            path = self._desk.write_incident(label)
        except SpotRlError as error:
            self.event(EventName.INCIDENT_FAILED, str(error))
        else:
            if path is not None:
                self.event(EventName.INCIDENT, f"the seconds around the stop are in {path}")
        self._desk.end(label)

    # Details ----------------------------------------------------------------------------------------------------------

    def _tell_armed(self) -> None:
        self._link.state("armed")
        self._status_due_ns = 0

    def _tell_status(self, hal: Hal, state: RobotState | None) -> None:
        now_ns = time.monotonic_ns()
        if now_ns < self._status_due_ns:
            return
        self._status_due_ns = now_ns + STATUS_PERIOD_NS
        self._link.status(
            status_of(
                robot_id=self._robot_id,
                policy=self.policy,
                loop=self.loop,
                state=state,
                slow=hal.slow_state,
                log_path=self.log_path,
                log=self._sink.health(),
            )
        )

    def _request(self, labels: dict[str, str]) -> RunRequest:
        name = log_file_name(self.policy.contract.name, self._source.name, 0, datetime.now(timezone.utc))
        path = self._config.log.directory / name
        all_labels = {**self._spec.labels, **labels}
        return RunRequest(self._spec.robot, self.policy, self._source, self._config, path, 0, all_labels)

    def _now_ns(self) -> int:
        return self._clock.now_ns() if self._hal is None else self._hal.host_now_ns()
