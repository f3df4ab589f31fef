"""When the policy ticks: 50 Hz of robot time, counted from acquisition stamps."""

from __future__ import annotations

from typing import NamedTuple


class TickSchedule(NamedTuple):
    """An absolute schedule over acquisition stamps: due instants lie a period apart, whatever the jitter.

    On the 3 ms stream a 20 ms period gives steps of 7, 7 and 6 messages: exactly 50 Hz on average.
    """

    period_ns: int
    next_due_robot_ns: int | None = None
    """None before the first state."""
    ticks: int = 0

    def advance(self, robot_stamp_ns: int) -> tuple[TickSchedule, bool, int]:
        """Look at one state's stamp.

        Returns:
            The new schedule, whether a tick is due on this state, and how many ticks were lost just before it.
        """
        if self.next_due_robot_ns is None:
            return TickSchedule(self.period_ns, robot_stamp_ns + self.period_ns, 1), True, 0
        late_ns = robot_stamp_ns - self.next_due_robot_ns
        if late_ns < 0:
            return self, False, 0
        lost = late_ns // self.period_ns
        due = self.next_due_robot_ns + (lost + 1) * self.period_ns
        return TickSchedule(self.period_ns, due, self.ticks + 1), True, lost


def schedule_for(rate_hz: float) -> TickSchedule:
    """A schedule for a policy's rate."""
    return TickSchedule(round(1e9 / rate_hz))
