"""How long somebody has been silent, in robot time and, in lock-step, also in host time."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Heartbeat:
    """The moment of a sign of life: what the robot's clock showed, and the time elapsed on both sides."""

    robot_stamp_ns: int
    robot_elapsed_ns: int
    host_stamp_ns: int


@dataclass(frozen=True)
class LivenessClock:
    """Measures silence, by elapsed time, so that setting the robot's clock neither ends nor prolongs it.

    In real time the two clocks run side by side. In lock-step, robot time can run ten times faster than the host's, on
    which a client's keep-alive thread runs, or not at all; with ``needs_both`` somebody counts as silent only when both
    clocks say so.
    """

    robot_now_ns: Callable[[], int]
    robot_elapsed_ns: Callable[[], int]
    needs_both: bool
    host_now_ns: Callable[[], int] = time.monotonic_ns

    def beat(self) -> Heartbeat:
        """Now."""
        return Heartbeat(self.robot_now_ns(), self.robot_elapsed_ns(), self.host_now_ns())

    def elapsed_s(self, heartbeat: Heartbeat) -> float:
        """Seconds since ``heartbeat``; the smaller of the two clocks where both count."""
        robot_ns = self.robot_elapsed_ns() - heartbeat.robot_elapsed_ns
        if not self.needs_both:
            return robot_ns * 1e-9
        return min(robot_ns, self.host_now_ns() - heartbeat.host_stamp_ns) * 1e-9
