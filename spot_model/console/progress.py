"""Progress of long work: a bar with the time left, or a plain line now and then without a terminal.

Between two messages the time that passes moves it on, towards the end of the part that is under way and never there.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from typing_extensions import Self

PLAIN_INTERVAL_S: Final = 15.0
TICK_S: Final = 5.0
ON_TIME: Final = 0.8
"""Share of a part that counts as done once it has taken as long as the pace so far says; a late one takes longer."""
LEAST_SHARE: Final = 0.03
"""Of work in per cent, what must be done before its pace says anything."""


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
        self._is_share, self._unit = total is None, " %" if total is None else f"/{total}"
        self._began_s, self._next_line_s = clock() - already_s, 0.0
        self._done, self._ahead, self._since_s, self._text, self._most = float(done), 1.0, clock(), "", float(done)
        self._lock, self._is_over = threading.RLock(), threading.Event()
        self._bar: Bar | None = None
        if self._console.is_terminal:
            count = TaskProgressColumn() if total is None else MofNCompleteColumn()
            columns = (BarColumn(), count, TimeElapsedColumn(), TextColumn("{task.fields[left]}"))
            self._bar = Bar(TextColumn(what), *columns, TextColumn("{task.fields[text]}"), console=self._console)
            self._bar.add_task(what, total=self._total, completed=done, text="", left="")
            self._bar.start()
        threading.Thread(target=self._tick, daemon=True).start()

    def update(self, done: float, text: str = "", *, ahead: float = 1.0, is_told: bool = False) -> None:
        """Show that ``done`` are done, and ``ahead`` under way; ``is_told`` prints the text as a line that stays."""
        with self._lock:
            if done > self._done:
                self._done, self._since_s = done, self._clock()
            self._ahead, self._text = ahead, text
            self._show(is_told=is_told)

    def _show(self, *, is_told: bool = False) -> None:
        now = self._clock()
        shown, left = self._estimate(now)
        done = int(shown + 1e-9)
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=done, text=self._text, left=left)
            if is_told:
                self._console.print(self._text, markup=False, soft_wrap=True)
            return
        if is_told or now >= self._next_line_s or done == self._total:
            self._next_line_s = now + PLAIN_INTERVAL_S
            told = "  ".join(part for part in (f"{self._what} {done}{self._unit}", left, self._text) if part)
            self._console.print(told, markup=False, highlight=False, soft_wrap=True)

    def _tick(self) -> None:
        while not self._is_over.wait(TICK_S):
            with self._lock:
                # It may have been stopped while this waited for the lock.
                if not self._is_over.is_set():
                    self._show()

    def stop(self) -> None:
        """Leave the last state on the screen."""
        with self._lock:
            self._is_over.set()
            if self._bar is not None:
                self._bar.stop()
                self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _estimate(self, now: float) -> tuple[float, str]:
        """How many are done, with the part under way at the pace so far, and the time left in words."""
        made, took_s, part_s = self._done - self._first, self._since_s - self._began_s, now - self._since_s
        if made <= LEAST_SHARE * self._total * self._is_share or took_s <= 0.0:
            return self._done, ""
        pace_s, usual_s = took_s / made, took_s / made * self._ahead
        gone = ON_TIME * part_s / usual_s if part_s < usual_s else 1.0 - (1.0 - ON_TIME) * usual_s / max(part_s, 1e-9)
        self._most = max(self._most, self._done + self._ahead * gone)
        part_left_s = max(usual_s - ON_TIME * part_s, (1.0 - ON_TIME) * part_s)
        left = pace_s * max(0.0, self._total - self._done - self._ahead) + part_left_s
        return self._most, "" if self._done >= self._total else f"left {int(left) // 60}:{int(left) % 60:02d}"
