"""SIGINT, SIGTERM, SIGHUP: the first asks for a stop in place, the second for damping at once. SIGQUIT: the e-stop."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Final

from typing_extensions import Self

from spot_runtime.stops import Stop, StopReason

HANDLED: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class OperatorInterrupt(BaseException):
    """The operator wants to stop while the program waits for the robot; carries the stop."""

    def __init__(self, stop: Stop) -> None:
        """Carry a stop."""
        super().__init__(stop.sentence())
        self.stop = stop


class StopSignals:
    """Turns signals into stops while it is entered.

    While the loop runs, ``take`` gives the newest stop. While the program waits in a call of the robot
    (``interrupts`` set), a signal raises :class:`OperatorInterrupt` there instead; while it brings the robot to rest
    (``only_estop`` set, too), the e-stop's alone does.
    """

    def __init__(self) -> None:
        """Count from zero."""
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put back what was there."""
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def take(self) -> Stop | None:
        """The stop that was asked for since the last call."""
        pending, self._pending = self._pending, None
        return pending

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._count += 1
        reason = StopReason.OPERATOR_STOP if self._count == 1 else StopReason.OPERATOR_DAMP
        reason = StopReason.OPERATOR_ESTOP if number == signal.SIGQUIT else reason
        stop = Stop(reason, signal.Signals(number).name)
        if self.interrupts and (number == signal.SIGQUIT or not self.only_estop):
            raise OperatorInterrupt(stop)
        self._pending = stop
