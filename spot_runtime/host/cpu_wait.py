"""How long threads of this process that could run have waited for a processor, as Linux counts it."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Final

from spot_model.robot.stamps import NS_PER_S

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
