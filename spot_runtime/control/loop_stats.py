"""What the loop measures of itself, in bounded memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

PENDING_MAX: Final = 64


class RecentValues:
    """A ring of numbers; when it is full, the oldest goes."""

    def __init__(self, capacity: int = 32_768) -> None:  # ten minutes at 50 Hz
        self._ring = np.full(capacity, np.nan)
        self.count = 0
        """Numbers taken since the start."""

    def add(self, value: float) -> None:
        """Take a number."""
        self._ring[self.count % self._ring.size] = value
        self.count += 1

    def newest(self, count: int) -> NDArray[np.float64]:
        """The newest numbers, at most ``count`` of them; the order within them is not kept."""
        size = min(count, self.count, self._ring.size)
        places = np.arange(self.count - size, self.count) % self._ring.size
        return self._ring[places]

    def percentile(self, percent: float) -> float:
        """A percentile of what is kept; NaN when nothing is."""
        return percentile(self._ring[: min(self.count, self._ring.size)], percent)


def percentile(values: NDArray[np.float64], percent: float) -> float:
    """A percentile, one of the values themselves; NaN of none.

    NumPy's own loads more of NumPy when it is first called, while a robot walks.
    """
    return float(np.sort(values)[round(percent / 100.0 * (values.size - 1))]) if values.size else float("nan")


class LoopStats:
    """Times of policy ticks and how long commands take to leave. Written by the loop's thread alone."""

    def __init__(self) -> None:
        self.compute_s = RecentValues()
        """State taken to command handed over, one tick."""
        self.state_age_s = RecentValues()
        """From the receipt of a state to the start of the tick that uses it."""
        self.acquisition_age_s = RecentValues()
        """From the sampling of the joints to the start of the tick, by the estimated robot clock; the delays of robot
        and link included."""
        self.state_to_command_s = RecentValues()
        """Receipt of a tick's state to the instant at which the transport took its command."""
        self.skipped_ticks = 0
        self.ticks = 0
        self._first_robot_ns = 0
        self._last_robot_ns = 0
        self._pending: dict[int, int] = {}

    def ticked(
        self, robot_stamp_ns: int, compute_s: float, state_age_s: float, acquisition_age_s: float, skipped: int
    ) -> None:
        """Take note of one tick."""
        if self.ticks == 0:
            self._first_robot_ns = robot_stamp_ns
        self._last_robot_ns = robot_stamp_ns
        self.ticks += 1
        self.skipped_ticks += skipped
        self.compute_s.add(compute_s)
        self.state_age_s.add(state_age_s)
        self.acquisition_age_s.add(acquisition_age_s)

    def sent(self, key: int, state_host_stamp_ns: int) -> None:
        """A tick's command was handed over; it answers a state received at this instant."""
        if len(self._pending) >= PENDING_MAX:
            self._pending.clear()
        self._pending[key] = state_host_stamp_ns

    def departures(self, departures: Sequence[tuple[int, int]]) -> None:
        """Commands that the transport took: their keys, and when."""
        for key, host_stamp_ns in departures:
            received_ns = self._pending.pop(key, None)
            if received_ns is not None:
                self.state_to_command_s.add((host_stamp_ns - received_ns) / 1e9)

    @property
    def rate_hz(self) -> float:
        """Ticks per second of robot time, over all ticks; NaN before the second."""
        if self.ticks < 2:
            return float("nan")
        return (self.ticks - 1) * 1e9 / (self._last_robot_ns - self._first_robot_ns)
