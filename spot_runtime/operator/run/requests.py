"""What each request of an operator does, depending on whether the policy has the joints."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from spot_log.format.events import EventName
from spot_log.write.sink import LogSink
from spot_model.errors import SpotRlError
from spot_model.policy.policy import Policy
from spot_protos import run_link_pb2
from spot_runtime.admission import gait_event
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.modes import Mode
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.run.link import RunLink
from spot_runtime.operator.run.run_logs import NewLog
from spot_runtime.operator.run.run_spec import RunSpec, load_checked
from spot_runtime.operator.run.steering import OperatorSource
from spot_runtime.session.run import Driver
from spot_runtime.stops import Reaction, Stop, StopReason

_BUSY: Final = "the request before this one is still being carried out; wait for its answer"


class BackgroundTask:
    """One task at a time, in a thread of its own; its result is taken up by the thread that runs the cycles."""

    def __init__(self, *, is_sync: bool) -> None:
        """With ``is_sync`` each task is done at once: in lock-step the robot waits anyway."""
        self._is_sync = is_sync
        self._thread: threading.Thread | None = None
        self._result: tuple[Any, Exception | None] | None = None
        self._then: Callable[[Any, Exception | None], None] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether one is under way."""
        return self._then is not None

    def run(self, task: Callable[[], Any], then: Callable[[Any, Exception | None], None]) -> None:
        """Begin a task; ``then`` gets its result or its error, called by :meth:`finish`. Raises RuntimeError."""
        if self.is_busy:
            raise RuntimeError("a task is under way")
        self._then, self._result = then, None
        if self._is_sync:
            self._work(task)
            self.finish()
            return
        self._thread = threading.Thread(target=self._work, args=(task,), name="background", daemon=True)
        self._thread.start()

    def finish(self) -> None:
        """Take up the result, if it is there."""
        if self._result is None or self._then is None:
            return
        (value, error), then = self._result, self._then
        self._result = self._then = self._thread = None
        then(value, error)

    def wait(self) -> None:
        """Wait for the end of one that is under way, and take up its result."""
        if self._thread is not None:
            self._thread.join()
        self.finish()

    def _work(self, task: Callable[[], Any]) -> None:
        try:
            self._result = (task(), None)
        except Exception as error:  # noqa: BLE001 - it is passed on to the caller
            self._result = (None, error)


class Requests(Driver, ABC):
    """The operator's side of a run: carries requests out, and answers each that needs an answer once."""

    def __init__(
        self, spec: RunSpec, policy: Policy, link: RunLink, sink: LogSink, manager: ServiceManager | None
    ) -> None:
        super().__init__(spec.config, sink, link.event, manager, " of the operator's service, or of the system")
        self.policy, self.link = policy, link
        self.source = OperatorSource(spec.config)
        self.background = BackgroundTask(is_sync=bool(spec.lock_step))
        """Slow work that must not hold up the robot's cycles."""
        self.loop: ControlLoop | None = None
        """None while the vendor's controller stands."""
        self.keeps_standing = False
        """Whether the robot goes on standing by after the control that ends now."""
        self.start_asked: run_link_pb2.ToRun | None = None
        """The request to start; it is answered once the robot has handed the joints over, or will not."""

    @property
    @abstractmethod
    def log_path(self) -> str:
        """The log that is being written; empty: none."""

    @abstractmethod
    def end(self, stop: Stop) -> None:
        """End the arming, or the control that is under way and then the arming."""

    @abstractmethod
    def open_log(self, labels: dict[str, str]) -> NewLog:
        """Open a log; in any thread. Raises LogError."""

    @abstractmethod
    def begin_log(self, log: NewLog) -> Path:
        """Write to this log from now on."""

    def refuse_start(self, why: str) -> None:
        """A start that was asked for, if one was, is not carried out."""
        asked, self.start_asked = self.start_asked, None
        if asked is not None:
            self.link.answer(asked.request_id, is_done=False, text=f"the policy did not get the joints; {why}")

    def handle(self, message: run_link_pb2.ToRun, host_ns: int) -> None:
        """Do what one message asks."""
        kind = message.WhichOneof("what")
        handlers: dict[str | None, Callable[[run_link_pb2.ToRun], None]] = {
            "velocity": lambda message: self._velocity(message, host_ns),
            "start": self._start,
            "stop": self._stop,
            "damp": self._damp,
            "switch_policy": self._switch_policy,
            "start_log": self._start_log,
            "label_log": self._label_log,
            "attend": lambda message: self._done(message, "seen"),
        }
        handler = handlers.get(kind)
        if handler is None:
            self._refuse(message, f"request {kind!r} is not known to the control process")
        else:
            handler(message)

    def _velocity(self, message: run_link_pb2.ToRun, host_ns: int) -> None:
        loop = self.loop
        if loop is None or loop.mode is not Mode.ACTIVE:
            mode = "standing by" if loop is None else loop.mode.value
            self._refuse(message, f"the velocity counts only while the policy is in full control; the mode is {mode}")
            return
        wanted = message.velocity
        velocity = np.array([wanted.v_x_m_s, wanted.v_y_m_s, wanted.yaw_rate_rad_s])
        if not np.isfinite(velocity).all():
            self._refuse(message, "the velocity holds a value that is no number")
            return
        self.source.steer(velocity, host_ns)
        self._done(message, "steering")

    def _start(self, message: run_link_pb2.ToRun) -> None:
        if self.loop is not None and self.start_asked is None:
            self._refuse(message, "the policy has the joints already")
        elif self.background.is_busy or self.start_asked is not None:
            self._refuse(message, _BUSY)
        else:
            self.start_asked = message
            if not self.log_path:
                self._open_log(message, {}, lambda *_: None)

    def _stop(self, message: run_link_pb2.ToRun) -> None:
        keeps = message.stop.keep_standing
        if self.loop is None and keeps:
            self.refuse_start("a stop came before it")
            self._done(message, "the robot stands under the vendor's control already")
            return
        self.end(Stop(StopReason.OPERATOR_STOP))
        ending = None if self.loop is None else self.loop.ending
        if ending is not None and ending.reaction is not Reaction.HAND_BACK:
            self._done(message, f"the run ends already: {ending.cause.sentence()}")
            return
        self.keeps_standing = keeps
        self._done(message, "stopping in place" + (", then standing" if keeps else ", then sitting and powering off"))

    def _damp(self, message: run_link_pb2.ToRun) -> None:
        if self.loop is None:
            self.end(Stop(StopReason.OPERATOR_STOP, "damping asked for while the vendor's controller stands"))
            self._done(message, "the vendor's controller has the joints: it sits and powers off")
            return
        self.end(Stop(StopReason.OPERATOR_DAMP))
        ending = self.loop.ending
        is_damped = self.loop.mode.sends and ending is not None and ending.reaction in (Reaction.DAMP, Reaction.ESTOP)
        how = "the joints are damped, the robot sinks to the ground" if is_damped else "nothing is sent any more"
        self._done(message, f"{how}; then the motors lose their power")

    def _switch_policy(self, message: run_link_pb2.ToRun) -> None:
        asked = message.switch_policy
        if self.loop is not None:
            self._refuse(message, "the policy has the joints; stop with keep_standing first")
        elif self.background.is_busy:
            self._refuse(message, _BUSY)
        elif self.log_path:
            self._refuse(message, "a log is being written, and its header names one policy; start, or sit down first")
        else:

            def load() -> Any:
                policy = load_checked(Path(asked.path), asked.sha256, self.config)
                policy.warm_up()
                return policy

            def then(policy: Any, error: Exception | None) -> None:
                if error is not None:
                    self._refuse(message, _words(error))
                    return
                self.policy = policy
                self.event(EventName.POLICY_SWITCHED, f"{policy.contract.name}, SHA-256 {policy.sha256}")
                self.event(*gait_event(policy.contract))
                self._done(message, f"policy {policy.contract.name} is loaded")

            self.background.run(load, then)

    def _start_log(self, message: run_link_pb2.ToRun) -> None:
        if self.log_path:
            self._refuse(message, f"a log is being written already: {self.log_path}; label it instead")
        elif self.background.is_busy:
            self._refuse(message, _BUSY)
        else:
            self._open_log(message, dict(message.start_log.labels), lambda m, path: self._done(m, str(path)))

    def _label_log(self, message: run_link_pb2.ToRun) -> None:
        if not self.log_path:
            self._refuse(message, "no log is being written; start one, or start the policy")
            return
        for key, value in sorted(message.label_log.labels.items()):
            self.event(EventName.LABEL, f"{key}={value}")
        self._done(message, f"labelled {self.log_path}")

    def _open_log(
        self, message: run_link_pb2.ToRun, labels: dict[str, str], then: Callable[[run_link_pb2.ToRun, Path], None]
    ) -> None:
        def take_up(log: Any, error: Exception | None) -> None:
            if error is None:
                then(message, self.begin_log(log))
            elif message is self.start_asked:
                self.refuse_start(_words(error))
            else:
                self._refuse(message, _words(error))

        self.background.run(lambda: self.open_log(labels), take_up)

    def _done(self, message: run_link_pb2.ToRun, text: str) -> None:
        self.link.answer(message.request_id, is_done=True, text=text)

    def _refuse(self, message: run_link_pb2.ToRun, text: str) -> None:
        self.link.answer(message.request_id, is_done=False, text=text)


def _words(error: Exception) -> str:
    return str(error) if isinstance(error, (SpotRlError, OSError)) else f"{type(error).__name__}: {error}"
