"""A bar with the time that is left, or a line now and then where there is no terminal."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PLAIN_INTERVAL_S = 20.0


class CaseProgress:
    """Shows how many cases are done, and what the last one gave."""

    def __init__(self, total: int, done: int, console: Console | None = None) -> None:
        """Begin with some cases done."""
        self._console = console or Console(stderr=True)
        self._total, self._done, self._first = total, done, done
        self._began_s = time.monotonic()
        self._next_s = 0.0
        self._bar: Progress | None = None
        if self._console.is_terminal:
            self._bar = Progress(
                TextColumn("cases"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                TextColumn("{task.fields[text]}"),
                console=self._console,
            )
            self._bar.add_task("cases", total=total, completed=done, text="")
            self._bar.start()

    def done(self, number: int, text: str) -> None:
        """One more; what failed is always told."""
        failed = text.startswith("failed")
        self._done += not failed
        line = f"case {number}: {text}"
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=self._done, text=line)
            if failed:
                self._console.print(line, markup=False)
            return
        now = time.monotonic()
        if failed or now >= self._next_s or self._done == self._total:
            self._next_s = now + PLAIN_INTERVAL_S
            made = max(1, self._done - self._first)
            left = (now - self._began_s) / made * (self._total - self._done)
            self._console.print(
                f"{self._done}/{self._total} cases, left {int(left) // 60}:{int(left) % 60:02d}; {line}", markup=False
            )

    def stop(self) -> None:
        """Leave the last state on the screen."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
