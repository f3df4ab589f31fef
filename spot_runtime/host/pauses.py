"""Sees where this process did not run: its loop looks every few milliseconds, so a longer gap is its own doing.

Stopped by a signal or a debugger, frozen, or on a computer that slept, a process uses no processor and waits for none;
behind a busy thread of its own it uses one, and on a busy computer it waits for one, as Linux counts it.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from spot_model.robot.facts import NS_PER_S
from spot_runtime.config import RealTimeConfig

TASKS: Final = Path("/proc/self/task")


class CpuWait:
    """Compares the counts of all threads with those at the last mark."""

    def __init__(self, tasks: Path = TASKS) -> None:
        self._tasks = tasks
        self._marked_ns: dict[str, int] = {}

    def mark(self) -> None:
        """Count from now on."""
        self._marked_ns = self._waited_ns()

    def since_mark_s(self) -> float | None:
        """The longest time that any one thread has waited since the mark; None where the system does not count."""
        waited_ns = self._waited_ns()
        if not any(waited_ns.values()) or not self._marked_ns:  # a kernel that does not count says 0
            return None
        return max(ns - self._marked_ns.get(thread, 0) for thread, ns in waited_ns.items()) / NS_PER_S

    def _waited_ns(self) -> dict[str, int]:
        """By thread: the second number of its ``schedstat``, ns on the run queue."""
        waited_ns = {}
        with contextlib.suppress(OSError):  # a system without it
            for thread in self._tasks.iterdir():
                with contextlib.suppress(OSError, IndexError, ValueError):  # a thread that has just ended
                    waited_ns[thread.name] = int((thread / "schedstat").read_bytes().split()[1])
        return waited_ns


SHORTEST_S: Final = 0.02
"""Half the age of a state that ends a run by default; the loop waits 4 ms at most."""
RECENT_S: Final = 2.0
"""A pause may explain what goes wrong up to this long after it: a stream that ended, a check-in that was missed."""
SHARE: Final = 0.5
"""Of a pause, or of the age of a state, which is mostly put down to what lasted so long."""


class Pause(NamedTuple):
    """The longest time of late in which the loop did not look; or what is known where there was none."""

    duration_s: float
    """0: none."""
    used_s: float = 0.0
    """Processor time that this process used meanwhile."""
    cpu_wait_s: float | None = None
    """The longest that any of its threads waited for a processor of late; None where the system does not count."""
    ago_s: float = 0.0
    """How long it has been over."""

    @property
    def is_for_want_of_a_processor(self) -> bool:
        """Whether other programs are the reason."""
        return self.cpu_wait_s is not None and self.cpu_wait_s >= SHARE * self.duration_s

    @property
    def is_standstill(self) -> bool:
        """Whether the whole process did not run, though nothing in this computer's accounts kept it from it."""
        return self.duration_s > 0.0 and not self.is_for_want_of_a_processor and self.used_s < SHARE * self.duration_s


def _now_s() -> float:
    return time.clock_gettime(time.CLOCK_BOOTTIME)  # goes on while the computer sleeps


class Pauses:
    """Keeps the longest pause of late."""

    def __init__(
        self,
        cpu_wait: CpuWait | None = None,
        now_s: Callable[[], float] = _now_s,
        used_s: Callable[[], float] = time.process_time,
        *,
        shortest_s: float = SHORTEST_S,
    ) -> None:
        """Begin to look; a gap of ``shortest_s`` or more is a pause."""
        self._shortest_s = shortest_s
        self._cpu_wait, self._now_s, self._used_s = cpu_wait or CpuWait(), now_s, used_s
        self._looked_s, self._used_then_s = now_s(), used_s()
        self._pause, self._ended_s = Pause(0.0), -RECENT_S

    def look(self) -> float:
        """The loop looks; call it each cycle. Returns how long it did not, if that is a pause; else 0. Unit: s."""
        now_s, used_s = self._now_s(), self._used_s()
        gap_s, spent_s = now_s - self._looked_s, used_s - self._used_then_s
        self._looked_s, self._used_then_s = now_s, used_s
        if now_s - self._ended_s > RECENT_S:
            self._pause = Pause(0.0)
        if gap_s < self._shortest_s:
            return 0.0
        if gap_s >= self._pause.duration_s:
            self._pause, self._ended_s = Pause(gap_s, spent_s, self._cpu_wait.since_mark_s()), now_s
        return gap_s

    @property
    def recent(self) -> Pause | None:
        """The longest pause of the last :data:`RECENT_S`; None where there was none."""
        pause = self._pause
        return pause._replace(ago_s=self._looked_s - self._ended_s) if pause.duration_s else None

    def mark(self) -> None:
        """Count waits for a processor from now on."""
        self._cpu_wait.mark()

    def waits(self) -> Pause:
        """The pause of late, or that there was none and how long threads waited for a processor."""
        return self.recent or Pause(0.0, 0.0, self._cpu_wait.since_mark_s())


def pauses(config: RealTimeConfig, *, shortest_s: float = SHORTEST_S) -> Pauses | None:
    """The watch, if it is wanted."""
    return Pauses(shortest_s=shortest_s) if config.watch_processor else None
