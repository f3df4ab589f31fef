"""Chores beside the loop, each due after its own period: keep-alives, time sync, polls."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass


@dataclass
class Job:
    """A chore and when it is due next."""

    name: str
    period_s: float
    run: Callable[[], None]
    due_s: float = 0.0


class Jobs:
    """Runs chores that are due. Time is whatever the caller passes: the host's clock, or lock-step's robot time."""

    def __init__(self, on_error: Callable[[str, Exception], None]) -> None:
        """An exception of a chore goes to ``on_error`` with the chore's name; the chore stays."""
        self._jobs: list[Job] = []
        self._on_error = on_error
        self._lock = threading.Lock()
        self.on_add: Callable[[str], None] = lambda _: None
        """Told of the name of each chore that is taken."""

    def add(self, name: str, period_s: float, run: Callable[[], None], *, now_s: float) -> None:
        """Take a chore; it is due a period from now."""
        with self._lock:
            self._jobs.append(Job(name, period_s, run, now_s + period_s))
        self.on_add(name)

    def remove(self, name: str) -> None:
        """Drop a chore; an unknown name is ignored, since it may have been dropped before."""
        with self._lock:
            self._jobs = [job for job in self._jobs if job.name != name]

    def run_due(self, now_s: float, name: str = "") -> float:
        """Run what is due, each chore once; only the one of this name, if there is one.

        Returns:
            Seconds until the next one is due; 1 where there is none.
        """
        with self._lock:
            jobs = [job for job in self._jobs if name in ("", job.name)]
        due = [job for job in jobs if job.due_s <= now_s]
        for job in due:
            job.due_s = now_s + job.period_s
            try:
                job.run()
            except Exception as error:  # noqa: BLE001 - one failing chore must not end the others
                self._on_error(job.name, error)
        return min((max(0.0, job.due_s - now_s) for job in jobs), default=1.0)
