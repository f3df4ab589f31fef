"""One arming of a robot, from the lease to power off: the vendor's controller stands, and the policy walks when asked.

    connect ──► stand ──► standing by ◄──► control ──► sit, power off
                              (each control is one log)

One thread does all of it. Whatever an operator asks comes through the link, a few messages a cycle; whatever goes wrong
ends at rest. When no operator attends, or the operator's service is gone, the robot stops in place, sits and powers
off.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Final

from spot_log.format.events import EventName
from spot_model.policy.policy import Policy
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import RobotState
from spot_model.version import software_revision
from spot_protos import operator_pb2
from spot_runtime.admission import gait_event
from spot_runtime.control.safety.battery import BatteryMemory
from spot_runtime.hal.base import Hal
from spot_runtime.host.pauses import pauses
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.run.link import RunLink
from spot_runtime.operator.run.requests import Requests
from spot_runtime.operator.run.run_logs import NewLog, RunLogs
from spot_runtime.operator.run.run_spec import RunSpec
from spot_runtime.operator.run.run_status import STATUS_PERIOD_NS, status_of
from spot_runtime.operator.run.steering import Attendance
from spot_runtime.session.robot_session import ControlEnd, check_standing, control_end, fall_of
from spot_runtime.session.run import HalFactory, RunRequest, SinkFactory, log_file_name, log_header
from spot_runtime.stops import Reaction, Stop, StopReason, unforeseen

STANDBY_PAUSE_S: Final = 0.2
"""Between two looks; far less than the silence of the robot that ends the arming."""

LOCK_STEP_PAUSE_S: Final = 0.002
"""In lock-step robot time would otherwise race while a person thinks."""


class OperatedRun(Requests):
    """Everything between an operator's Arm and the robot at rest."""

    def __init__(
        self, spec: RunSpec, policy: Policy, link: RunLink, make_sink: SinkFactory, *, manager: ServiceManager | None
    ) -> None:
        """Prepare to run a loaded policy; ``manager`` is told of progress while this process answers for the robot."""
        self._logs = RunLogs(make_sink)
        super().__init__(spec, policy, link, self._logs.sink, manager)
        self._spec = spec
        software_revision()  # kept from now on: no later log waits for git while the robot stands
        self.attendance = Attendance(spec.config, self.now_ns())
        self.stop: Stop | None = None
        """Why the whole arming ends; None while it goes on."""
        self._status_due_ns = 0
        self._status_ticks = -1

    def drive(self, make_hal: HalFactory) -> operator_pb2.Outcome:
        """Do it all. Returns how it ended, which is also told to the service."""
        with self.signals:
            try:
                self.ask_for_real_time()
                self.session.drive(lambda: self.make(make_hal, self.policy), self._serve)
            finally:
                self.background.wait()
                self._end_log(self.session.outcome.label or StopReason.INTERNAL_ERROR.label)
            end = self.session.outcome
            end = end.after_loss_of_log(self._logs.loss) if self._logs.loss else end
            outcome = operator_pb2.Outcome(
                outcome=end.label,
                exit_code=end.exit_code,
                sentence=end.sentence,
                log_paths=[str(path) for path in self._logs.paths],
                host_stamp_ns=self._clock.now_ns(),
            )
            self.link.ended(outcome)  # a signal that came before it would otherwise take this word away
        return outcome

    def shutting_down(self) -> None:
        """The service is told."""
        self.link.state("ending")

    # What requests use ------------------------------------------------------------------------------------------------

    @property
    def log_path(self) -> str:
        """The log that is being written; empty: none."""
        return "" if self._logs.path is None else str(self._logs.path)

    def end(self, stop: Stop) -> None:
        """End the arming, or the control that is under way and then the arming."""
        self.keeps_standing = False
        if self.loop is not None:
            self.loop.ask_stop(stop)
        elif self.stop is None or stop.reason.reaction.level > self.stop.reason.reaction.level:
            self.stop = stop
            hal = self.session.hal
            if stop.reason.reaction is Reaction.ESTOP and hal is not None:
                hal.estop()
            self.event(stop.event_name, f"{stop.reason.label}: {stop.sentence()}")

    def open_log(self, labels: dict[str, str]) -> NewLog:
        """Open a log; in any thread. Raises LogError."""
        request = self._request(labels)
        return self._logs.open(request.log_path, log_header(request, self.now_ns()))

    def begin_log(self, log: NewLog) -> Path:
        """Write to this log from now on."""
        self._logs.begin(log)
        self.event(EventName.RUN_STARTED, f"policy {self.policy.contract.name}, {self.source.name}")
        self.event(*gait_event(self.policy.contract))
        return log.path

    # The way through --------------------------------------------------------------------------------------------------

    def _serve(self, hal: Hal) -> ControlEnd:
        """Stand by and control in turn, until something ends it."""
        self.attendance = Attendance(self.config, hal.host_now_ns())
        fallen = self._fall(hal)
        if fallen is not None:
            return fallen
        self.event(EventName.ARMED, f"policy {self.policy.contract.name}")
        self._tell_armed()
        while True:
            stop = self._stand_by(hal)
            if stop is not None:
                self.refuse_start(stop.sentence())
                return ControlEnd(stop, may_stand=False)
            end = self._control(hal)
            if not (self.keeps_standing and end.may_stand and end.stop.reason is StopReason.OPERATOR_STOP):
                return end
            self.link.state("arming")
            hal.stand()
            fallen = self._fall(hal)
            if fallen is not None:
                return fallen
            # Only now: a robot that does not stand has not ended as the operator wanted. A slow disk takes seconds.
            self.background.run(partial(self._logs.end, end.stop.reason.label), self._log_ended)

    def _stand_by(self, hal: Hal) -> Stop | None:
        """Until a start is asked for (None), or the end."""
        self.stop, self.start_asked = None, None
        newest_ns, battery = hal.host_now_ns(), BatteryMemory()
        watch = pauses(self.config.real_time, shortest_s=STANDBY_PAUSE_S)
        while self._waits():
            states = hal.receive(0, 0.02)
            # While this process does not run, nobody can say that the robot is silent.
            paused_ns = 0 if watch is None else round(watch.look() * NS_PER_S)
            newest_ns = states[-1].host_stamp_ns if states else newest_ns + paused_ns
            self._look()
            battery, wrong = check_standing(hal, states[-1:], newest_ns, battery, self.config.safety)
            if wrong is not None:
                self.end(wrong)
            self.background.finish()
            self._tell_status(hal, states[-1] if states else None)
            self.manager.progressed()
            if self._spec.lock_step:
                time.sleep(LOCK_STEP_PAUSE_S)
        return self.stop

    def _waits(self) -> bool:
        return self.stop is None and (self.background.is_busy or self.start_asked is None)

    def _control(self, hal: Hal) -> ControlEnd:
        self.keeps_standing = False
        self.source.let_go()
        loop = self.loop_of(hal, self.policy, self.source)
        self.loop, self._status_ticks = loop, -1
        self.link.state("running")
        try:
            while not loop.is_done:
                self._look()
                loop.cycle()
                if self.start_asked is not None and loop.mode.runs_policy:
                    asked, self.start_asked = self.start_asked, None
                    self.link.answer(asked.request_id, is_done=True, text="the joints are handed over to the policy")
                if loop.stats.ticks != self._status_ticks:  # the longest pause until the next tick begins now
                    self._status_ticks = loop.stats.ticks
                    self._tell_status(hal, loop.newest)
                self.manager.progressed()
        finally:
            self.loop = None
            self.refuse_start("control ended" if loop.stop is None else loop.stop.sentence())
        return control_end(loop.ending)

    def _look(self) -> None:
        """Take what operators and signals want, and see whether anybody is there."""
        now_ns = self.now_ns()
        asked = self.signals.take()
        if asked is not None:
            self.end(asked)
        for message in self.link.take():
            self.attendance.seen(now_ns)
            self.handle(message, now_ns)
        if self.link.is_lost:
            self.end(Stop(StopReason.SERVICE_LOST))
        gone = self.attendance.check(now_ns)
        if gone is not None:
            self.end(gone)

    def _fall(self, hal: Hal) -> ControlEnd | None:
        """How it ends for a robot that does not stand as the vendor's controller says."""
        fallen = fall_of(hal, self.config.safety)
        if fallen is None:
            return None
        self.event(fallen.event_name, f"{fallen.reason.label}: {fallen.sentence()}")
        return ControlEnd(fallen, may_stand=False)

    # Ends -------------------------------------------------------------------------------------------------------------

    def _end_log(self, label: str) -> None:
        """Close the log; where something went wrong, write what led to it first."""
        told = self._logs.write_flight_record(label)
        if told is not None:
            self.event(*told)
        self._logs.end(label)

    def _log_ended(self, _: None, error: Exception | None) -> None:
        if error is not None:
            self.end(unforeseen(error))
        elif self.stop is None:
            self._tell_armed()

    # Details ----------------------------------------------------------------------------------------------------------

    def _tell_armed(self) -> None:
        self.link.state("armed")
        self._status_due_ns = 0

    def _tell_status(self, hal: Hal, state: RobotState | None) -> None:
        now_ns = time.monotonic_ns()
        if now_ns < self._status_due_ns:
            return
        self._status_due_ns = now_ns + STATUS_PERIOD_NS
        self.link.status(
            status_of(
                robot_id=self.session.robot_id,
                policy=self.policy,
                loop=self.loop,
                state=state,
                slow=hal.slow_state,
                log_path=self.log_path,
                log=self.sink.health(),
            )
        )

    def _request(self, labels: dict[str, str]) -> RunRequest:
        name = log_file_name(self.policy.contract.name, self.source.name, 0)
        path = self.config.log.directory / name
        all_labels = {**self._spec.labels, **labels}
        return RunRequest(self._spec.robot, self.policy, self.source, self.config, path, 0, all_labels)
