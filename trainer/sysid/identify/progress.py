"""A bar with the time that is left, or plain lines where there is no terminal."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PLAIN_INTERVAL_S = 15.0


class SearchProgress:
    """Shows how far a search is, and its best score."""

    def __init__(self, total: int, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._total = total
        self._started_s = time.monotonic()
        self._next_line_s = 0.0
        self._best = float("inf")
        self._bar: Progress | None = None

    def update(self, done: int, score: float) -> None:
        """Show that ``done`` generations are done, the last with this best score."""
        self._best = min(self._best, score)
        text = f"best score {self._best:.3f}"
        if self._console.is_terminal:
            self._draw(done, text)
            return
        now = time.monotonic()
        if now >= self._next_line_s or done == self._total:
            self._next_line_s = now + PLAIN_INTERVAL_S
            left = (now - self._started_s) / done * (self._total - done)
            self._console.print(
                f"generation {done}/{self._total}  {text}  left {int(left) // 60}:{int(left) % 60:02d}", markup=False
            )

    def stop(self) -> None:
        """Leave the last state on the screen."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def _draw(self, done: int, text: str) -> None:
        if self._bar is None:
            columns = (
                TextColumn("searching"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                TextColumn("{task.fields[text]}"),
            )
            self._bar = Progress(*columns, console=self._console)
            self._bar.add_task("searching", total=self._total, text=text)
            self._bar.start()
        self._bar.update(self._bar.task_ids[0], completed=done, text=text)
