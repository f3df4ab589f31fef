"""What each request of an operator does, depending on whether the policy has the joints."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from spot_log.format.events import EventName
from spot_model.errors import SpotRlError
from spot_protos import run_link_pb2
from spot_runtime.admission import gait_event
from spot_runtime.control.modes import Mode
from spot_runtime.operator.run.run_spec import load_checked
from spot_runtime.stops import Reaction, Stop, StopReason

if TYPE_CHECKING:
    from spot_runtime.operator.run.operated_run import OperatedRun

_BUSY: Final = "the request before this one is still being carried out; wait for its answer"
_NOT_STANDING: Final = "the policy has the joints; stop with keep_standing first"


class Requests:
    """Carries out requests on a run, and answers each that needs an answer once."""

    def __init__(self, run: OperatedRun) -> None:
        self._run = run

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
        loop = self._run.loop
        if loop is None or loop.mode is not Mode.ACTIVE:
            mode = "standing by" if loop is None else loop.mode.value
            self._refuse(message, f"the velocity counts only while the policy is in full control; the mode is {mode}")
            return
        wanted = message.velocity
        velocity = np.array([wanted.v_x_m_s, wanted.v_y_m_s, wanted.yaw_rate_rad_s])
        if not np.isfinite(velocity).all():
            self._refuse(message, "the velocity holds a value that is no number")
            return
        self._run.source.steer(velocity, host_ns)
        self._done(message, "steering")

    def _start(self, message: run_link_pb2.ToRun) -> None:
        run = self._run
        if run.loop is not None and run.start_asked is None:
            self._refuse(message, "the policy has the joints already")
        elif run.background.is_busy or run.start_asked is not None:
            self._refuse(message, _BUSY)
        else:
            run.start_asked = message
            if not run.log_path:
                self._open_log(message, {}, lambda *_: None)

    def _stop(self, message: run_link_pb2.ToRun) -> None:
        run, keeps = self._run, message.stop.keep_standing
        if run.loop is None and keeps:
            run.refuse_start("a stop came before it")
            self._done(message, "the robot stands under the vendor's control already")
            return
        run.end(Stop(StopReason.OPERATOR_STOP))
        ending = None if run.loop is None else run.loop.ending
        if ending is not None and ending.reaction is not Reaction.HAND_BACK:
            self._done(message, f"the run ends already: {ending.cause.sentence()}")
            return
        run.keeps_standing = keeps
        self._done(message, "stopping in place" + (", then standing" if keeps else ", then sitting and powering off"))

    def _damp(self, message: run_link_pb2.ToRun) -> None:
        run = self._run
        if run.loop is None:
            run.end(Stop(StopReason.OPERATOR_STOP, "damping asked for while the vendor's controller stands"))
            self._done(message, "the vendor's controller has the joints: it sits and powers off")
            return
        run.end(Stop(StopReason.OPERATOR_DAMP))
        ending = run.loop.ending
        is_damped = run.loop.mode.sends and ending is not None and ending.reaction in (Reaction.DAMP, Reaction.ESTOP)
        how = "the joints are damped, the robot sinks to the ground" if is_damped else "nothing is sent any more"
        self._done(message, f"{how}; then the motors lose their power")

    def _switch_policy(self, message: run_link_pb2.ToRun) -> None:
        run, asked = self._run, message.switch_policy
        if run.loop is not None:
            self._refuse(message, _NOT_STANDING)
        elif run.background.is_busy:
            self._refuse(message, _BUSY)
        elif run.log_path:
            self._refuse(message, "a log is being written, and its header names one policy; start, or sit down first")
        else:

            def load() -> Any:
                policy = load_checked(Path(asked.path), asked.sha256, run.config)
                policy.warm_up()
                return policy

            def then(policy: Any, error: Exception | None) -> None:
                if error is not None:
                    self._refuse(message, _words(error))
                    return
                run.policy = policy
                run.event(EventName.POLICY_SWITCHED, f"{policy.contract.name}, SHA-256 {policy.sha256}")
                run.event(*gait_event(policy.contract))
                self._done(message, f"policy {policy.contract.name} is loaded")

            run.background.run(load, then)

    def _start_log(self, message: run_link_pb2.ToRun) -> None:
        if self._run.log_path:
            self._refuse(message, f"a log is being written already: {self._run.log_path}; label it instead")
        elif self._run.background.is_busy:
            self._refuse(message, _BUSY)
        else:
            self._open_log(message, dict(message.start_log.labels), lambda m, path: self._done(m, str(path)))

    def _label_log(self, message: run_link_pb2.ToRun) -> None:
        if not self._run.log_path:
            self._refuse(message, "no log is being written; start one, or start the policy")
            return
        for key, value in sorted(message.label_log.labels.items()):
            self._run.event(EventName.LABEL, f"{key}={value}")
        self._done(message, f"labelled {self._run.log_path}")

    def _open_log(
        self, message: run_link_pb2.ToRun, labels: dict[str, str], then: Callable[[run_link_pb2.ToRun, Path], None]
    ) -> None:
        def take_up(log: Any, error: Exception | None) -> None:
            if error is None:
                then(message, self._run.begin_log(log))
            elif message is self._run.start_asked:
                self._run.refuse_start(_words(error))
            else:
                self._refuse(message, _words(error))

        self._run.background.run(lambda: self._run.open_log(labels), take_up)

    def _done(self, message: run_link_pb2.ToRun, text: str) -> None:
        self._run.link.answer(message.request_id, is_done=True, text=text)

    def _refuse(self, message: run_link_pb2.ToRun, text: str) -> None:
        self._run.link.answer(message.request_id, is_done=False, text=text)


def _words(error: Exception) -> str:
    return str(error) if isinstance(error, (SpotRlError, OSError)) else f"{type(error).__name__}: {error}"
