"""A bar with the time that is left, or plain lines where there is no terminal."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PLAIN_INTERVAL_S = 15.0


class TrainingProgress:
    """Shows how far a training run is."""

    def __init__(self, total: int, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._total = total
        self._next_line_s = 0.0
        self._started_s: float | None = None
        self._first = 0
        self._bar: Progress | None = None

    def update(self, iteration: int, metrics: dict[str, float]) -> None:
        """Show that ``iteration`` is done."""
        now = time.monotonic()
        if self._started_s is None:
            self._started_s, self._first = now, iteration
        text = _summary(metrics)
        if not self._console.is_terminal:
            if now >= self._next_line_s or iteration + 1 == self._total:
                self._next_line_s = now + PLAIN_INTERVAL_S
                self._console.print(f"{iteration + 1}/{self._total} {text} {self._left(now, iteration)}", markup=False)
            return
        if self._bar is None:
            self._bar = Progress(
                TextColumn("training"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                TextColumn("{task.fields[text]}"),
                console=self._console,
            )
            self._bar.add_task("training", total=self._total, completed=iteration, text=text)
            self._bar.start()
        self._bar.update(self._bar.task_ids[0], completed=iteration + 1, text=text)

    def stop(self) -> None:
        """Leave the last state on the screen."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def _left(self, now: float, iteration: int) -> str:
        done = iteration - self._first
        if done <= 0 or self._started_s is None:
            return ""
        left = (now - self._started_s) / done * (self._total - iteration - 1)
        return f"left {int(left) // 60}:{int(left) % 60:02d}"


def _summary(metrics: dict[str, float]) -> str:
    parts = [f"{metrics['steps_per_s']:,.0f} steps/s"]
    for key, label in (("reward", "reward"), ("episode_length", "length"), ("fall_share", "falls")):
        if key in metrics:
            parts.append(f"{label} {metrics[key]:.2f}")
    return "  ".join(parts)
