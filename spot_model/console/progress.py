"""Progress of long work: a bar with the time left, or a plain line now and then without a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar
from typing_extensions import Self

PLAIN_INTERVAL_S: Final = 15.0


class Progress:
    """Shows how many of ``total`` are done; a context manager that leaves the last state on the screen.

    Args:
        what: Of which they are, such as ``generations``.
        total: How many; None if ``done`` is in per cent.
        done: How many are done at the start; work that is resumed begins there, and its time left counts from there.
        already_s: How long the work has gone on since then.
        console: Standard error by default.
        clock: Seconds, for the time left.
    """

    def __init__(
        self,
        what: str,
        total: int | None = None,
        *,
        done: int = 0,
        already_s: float = 0.0,
        console: Console | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console = console or Console(stderr=True)
        self._what, self._total, self._first, self._clock = what, 100 if total is None else total, done, clock
        self._unit = " %" if total is None else f"/{total}"
        self._began_s, self._next_line_s = clock() - already_s, 0.0
        self._bar: Bar | None = None
        if self._console.is_terminal:
            count = TaskProgressColumn() if total is None else MofNCompleteColumn()
            columns = (BarColumn(), count, TimeElapsedColumn(), TimeRemainingColumn())
            self._bar = Bar(TextColumn(what), *columns, TextColumn("{task.fields[text]}"), console=self._console)
            self._bar.add_task(what, total=self._total, completed=done, text="")
            self._bar.start()

    def update(self, done: int, text: str = "", *, is_told: bool = False) -> None:
        """Show that ``done`` are done; ``is_told`` prints the text as a line that stays."""
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=done, text=text)
            if is_told:
                self._console.print(text, markup=False, soft_wrap=True)
            return
        now = self._clock()
        if is_told or now >= self._next_line_s or done == self._total:
            self._next_line_s = now + PLAIN_INTERVAL_S
            parts = [f"{self._what} {done}{self._unit}", self._left(now, done), text]
            told = "  ".join(part for part in parts if part)
            self._console.print(told, markup=False, highlight=False, soft_wrap=True)

    def stop(self) -> None:
        """Leave the last state on the screen."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _left(self, now: float, done: int) -> str:
        made = done - self._first
        if made <= 0:
            return ""
        left = (now - self._began_s) / made * (self._total - done)
        return f"left {int(left) // 60}:{int(left) % 60:02d}"
