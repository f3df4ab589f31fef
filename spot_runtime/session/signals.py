"""SIGINT, SIGTERM, SIGHUP: the first asks for a stop in place, the second for damping at once. SIGQUIT: the e-stop.

SIGTSTP (Ctrl-Z) counts as the first three do: a process that stood still would leave the robot to itself.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

from typing_extensions import Self

from spot_runtime.stops import Reaction, Stop, StopReason

HANDLED: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP, signal.SIGQUIT)


class OperatorInterrupt(BaseException):
    """The operator wants to stop while the program waits for the robot; carries the stop."""

    def __init__(self, stop: Stop) -> None:
        super().__init__(stop.sentence())
        self.stop = stop


class StopSignals:
    """Turns signals into stops while it is entered.

    While the loop runs, ``take`` gives the strongest stop that was asked for. While the program waits in a call of the
    robot (after :meth:`interrupt_waits`), a signal raises :class:`OperatorInterrupt` there instead; while it brings the
    robot to rest, the e-stop's alone does. After one interrupt there is no other until they are allowed again: signals
    often come in pairs, and the second must not interrupt the answer to the first.
    """

    def __init__(self, sender: str = "") -> None:
        """Prepare; ``sender`` says in words who sends signals here, where that is not the operator."""
        self._sender = sender
        self.interrupts = False
        self.only_estop = False
        self._count = 0
        self._pending: Stop | None = None
        self._previous: dict[signal.Signals, Callable[[int, FrameType | None], Any] | int | None] = {}

    def __enter__(self) -> Self:
        """Install the handlers; only the main thread may."""
        for number in HANDLED:
            self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def interrupt_waits(self, *, only_estop: bool = False) -> None:
        """From now on a signal interrupts; an e-stop that was pressed before, and not taken, does so at once.

        Raises:
            OperatorInterrupt: There was one.
        """
        self.only_estop = only_estop
        self.interrupts = True
        pending = self._pending
        if pending is not None and pending.reason.reaction is Reaction.ESTOP:
            self.interrupts, self._pending = False, None
            raise OperatorInterrupt(pending)

    def take(self) -> Stop | None:
        """The stop that was asked for since the last call."""
        pending, self._pending = self._pending, None
        return pending

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._count += 1
        reason = StopReason.OPERATOR_STOP if self._count == 1 else StopReason.OPERATOR_DAMP
        reason = StopReason.OPERATOR_ESTOP if number == signal.SIGQUIT else reason
        stop = Stop(reason, signal.Signals(number).name + self._sender)
        if self.interrupts and (number == signal.SIGQUIT or not self.only_estop):
            self.interrupts = False
            raise OperatorInterrupt(stop)
        if self._pending is None or self._pending.reason.reaction.level <= reason.reaction.level:
            self._pending = stop
