"""One arming as the service knows it: its process, what that has told, who waits for its answers, and who steers."""

from __future__ import annotations

import signal
import time
from concurrent.futures import Future
from typing import Final

from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.operator.door.access import not_now
from spot_runtime.operator.server.run_process import RunProcess
from spot_runtime.operator.server.service_state import State
from spot_runtime.stops import StopReason

STEERING_HELD_S: Final = 1.0


class PendingRequests:
    """All that wait, by number. Its owner's lock guards it."""

    def __init__(self) -> None:
        self._count = 0
        self._waiting: dict[int, Future[run_link_pb2.Answer]] = {}

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, request: run_link_pb2.ToRun) -> Future[run_link_pb2.Answer]:
        """Number a request that is about to be sent. Returns its answer to come; cancelled, none will."""
        self._count += 1
        request.request_id = self._count
        pending = self._waiting[self._count] = Future()
        return pending

    def take(self, answer: run_link_pb2.Answer) -> None:
        """An answer has come."""
        pending = self._waiting.get(answer.request_id)
        if pending is not None and not pending.done():
            pending.set_result(answer)

    def forget(self, request_id: int) -> None:
        """The request is no longer waited for."""
        self._waiting.pop(request_id, None)

    def let_all_go(self) -> None:
        """Release all requests that wait: no answer will come."""
        for pending in list(self._waiting.values()):
            pending.cancel()


class SteeringRight:
    """Belongs to whoever steered last, for :data:`STEERING_HELD_S`. Its owner's lock guards it."""

    def __init__(self) -> None:
        self._held_by, self._since_s = ("", ""), -STEERING_HELD_S

    @property
    def holder(self) -> str:
        """Who steers; empty: nobody."""
        identity, name = self._held_by
        return (name or identity) if time.monotonic() - self._since_s < STEERING_HELD_S else ""

    def check(self, identity: str, name: str) -> None:
        """Refuse anybody but the holder. Raises Refusal."""
        if self.holder and (identity, name) != self._held_by:
            raise not_now(f"velocity: {self.holder} steers; wait until they stop")

    def take(self, identity: str, name: str) -> None:
        """They steer now."""
        self._held_by, self._since_s = (identity, name), time.monotonic()


KILL_AFTER_S: Final = 15.0
SILENT_S: Final = 5.0
"""A control process that is silent for so long hangs; what it last sent has long lapsed, so it is ended."""
ABORT_TAKES_S: Final = 2.0


class ArmedRun:
    """Lives as long as its process; its owner's lock guards it."""

    def __init__(self, process: RunProcess) -> None:
        self.process = process
        self.waiting = PendingRequests()
        self.status: operator_pb2.RunStatus | None = None
        self._told_s = time.monotonic()
        self._ended: operator_pb2.Outcome | None = None
        self._has_begun = False
        self._is_asked_to_end = self._is_signalled = False

    def signal_stop(self) -> None:
        """Without the socket, and once: a second such signal would damp the robot of an operator who asks twice."""
        if not self._is_signalled:
            self._is_signalled = True
            self.process.ask_to_stop()

    @property
    def silent_s(self) -> float:
        """Seconds since the last status, or since the start."""
        return time.monotonic() - self._told_s

    @property
    def mode(self) -> str:
        """Mode of the control loop, as last reported; empty before."""
        return "" if self.status is None else self.status.mode

    def take(self, message: run_link_pb2.FromRun) -> None:
        """Take an answer, a status or the last word; whatever else it tells is the service's matter."""
        kind, self._has_begun = message.WhichOneof("what"), True
        if kind == "answer":
            self.waiting.take(message.answer)
        elif kind == "status":
            self.status, self._told_s = message.status, time.monotonic()
        elif kind == "ended":
            self._ended = message.ended

    def outcome(self, code: int) -> operator_pb2.Outcome:
        """How the run ended, well only by its last word, now that its process has; waiting requests are released."""
        self.waiting.let_all_go()
        own = min(code, 0) or StopReason.INTERNAL_ERROR.exit_code
        sentence = _how_it_died(code, has_begun=self._has_begun)
        return self._ended or operator_pb2.Outcome(outcome="control_process_died", exit_code=own, sentence=sentence)

    def keep_times(self, state: State, since_s: float, arm_timeout_s: float) -> tuple[str, str] | None:
        """Abort a process that hangs, so that it tells where; kill it if that does not end it.

        The state began at ``since_s``, monotonic clock; arming, and the way to rest, take ``arm_timeout_s`` at most.

        Returns:
            Name and words of an event to tell, once; None otherwise.
        """
        in_state_s = time.monotonic() - since_s
        if state in (State.ARMED, State.RUNNING):
            silent_s = min(self.silent_s, in_state_s)
            if silent_s > SILENT_S and self._is_first_measure():
                self.process.abort()
                return "silent", f"the control process has said nothing for {silent_s:.1f} s"
            if silent_s > SILENT_S + ABORT_TAKES_S:  # stopped or blocked, it has not even seen the abort
                self.process.kill()
        elif in_state_s > arm_timeout_s and self._is_first_measure():
            self.signal_stop()
            return "late", f"{state.value} takes too long; it is broken off"
        elif in_state_s > arm_timeout_s + KILL_AFTER_S:
            self.process.kill()
        return None

    def _is_first_measure(self) -> bool:
        is_first, self._is_asked_to_end = not self._is_asked_to_end, True
        return is_first


def _how_it_died(code: int, *, has_begun: bool) -> str:
    """A control process that ended without its last word."""
    how = f"with signal {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    if code == 0:
        how = "with exit code 0, or with one that the system has lost,"
    if not has_begun:
        return (
            f"the control process ended {how} before it had begun, so it touched no robot; see to this computer, which "
            "may be too busy, then arm again"
        )
    return (
        f"the control process ended {how} and said nothing more; the robot's own time-outs ended the motion; "
        "see to the robot, then arm again"
    )
