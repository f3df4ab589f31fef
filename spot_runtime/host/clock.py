"""Clocks: a host clock that never jumps, and an estimate of the robot's clock that is only ever bent."""

from __future__ import annotations

import time
from collections import deque
from typing import Final, NamedTuple

SLEW_S_PER_S: Final = 0.002
"""How fast the estimate may be bent: far above any crystal's drift, far below what could hurt an end time."""

WINDOW: Final = 16
"""Samples among which the best counts: that of the shortest round trip, to which its age adds."""

DRIFT_S_PER_S: Final = 1e-4
"""How far two clocks may part while a sample grows old: two crystals, each good to 50 parts in a million."""


class HostClock:
    """UNIX time that was read once and runs on with the monotonic clock, so that a set clock moves nothing."""

    def __init__(self) -> None:
        self._unix_minus_monotonic_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Nanoseconds since 1970, as the system's clock would have had it."""
        return time.monotonic_ns() + self._unix_minus_monotonic_ns


class ClockSample(NamedTuple):
    """One round trip: host stamps at both ends, robot stamps between them."""

    host_sent_ns: int
    robot_received_ns: int
    robot_sent_ns: int
    host_received_ns: int

    @property
    def round_trip_ns(self) -> int:
        """Time under way, both directions together."""
        return (self.host_received_ns - self.host_sent_ns) - (self.robot_sent_ns - self.robot_received_ns)

    @property
    def skew_ns(self) -> int:
        """Robot clock minus host clock, if both directions took equally long."""
        return (self.robot_received_ns - self.host_sent_ns + self.robot_sent_ns - self.host_received_ns) // 2


class _Line(NamedTuple):
    """The estimate from one instant on: where it starts, and where it may be bent to."""

    host_stamp_ns: int
    skew_ns: int
    aim_ns: int


class RobotClockEstimate:
    """The robot's clock from round trips. One thread adds samples; any thread reads.

    The estimate starts at the first sample and then moves towards the best recent one by at most
    :data:`SLEW_S_PER_S`, so that neither a bad sample nor a clock that was set makes an end time jump.
    """

    def __init__(self) -> None:
        self._samples: deque[ClockSample] = deque(maxlen=WINDOW)
        self._line: _Line | None = None

    def add(self, sample: ClockSample) -> int:
        """Take a round trip.

        Returns:
            How far this sample lies from the estimate in use, less what its round trip leaves open, ns: large after a
            clock was set, 0 otherwise.
        """
        self._samples.append(sample)
        host_ns = sample.host_received_ns
        best = min(self._samples, key=lambda s: s.round_trip_ns + 2.0 * DRIFT_S_PER_S * (host_ns - s.host_received_ns))
        skew_ns = best.skew_ns if self._line is None else self._skew_at(self._line, host_ns)
        self._line = _Line(host_ns, skew_ns, best.skew_ns)
        return max(0, abs(sample.skew_ns - skew_ns) - sample.round_trip_ns // 2)

    def skew_ns(self, host_stamp_ns: int) -> int:
        """Robot clock minus host clock at a host instant. Raises RuntimeError: there was no sample yet."""
        line = self._line
        if line is None:
            raise RuntimeError("the robot's clock is not known yet; add a round trip first")
        return self._skew_at(line, host_stamp_ns)

    def robot_ns(self, host_stamp_ns: int) -> int:
        """The robot's clock at a host instant. Raises like :meth:`skew_ns`."""
        return host_stamp_ns + self.skew_ns(host_stamp_ns)

    def uncertainty_ns(self) -> int:
        """Half the shortest recent round trip; 0 without a sample."""
        return min((s.round_trip_ns for s in self._samples), default=0) // 2

    @staticmethod
    def _skew_at(line: _Line, host_stamp_ns: int) -> int:
        reach_ns = round(max(0, host_stamp_ns - line.host_stamp_ns) * SLEW_S_PER_S)
        return line.skew_ns + max(-reach_ns, min(reach_ns, line.aim_ns - line.skew_ns))
