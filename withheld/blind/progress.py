"""How many cases are done, and what the last one gave."""

from __future__ import annotations

from rich.console import Console

from spot_model.io.progress import Progress


class CaseProgress:
    """Shows how many of ``total`` cases are done; some may be done at the start."""

    def __init__(self, total: int, done: int, console: Console | None = None) -> None:
        self._progress = Progress("cases", total, done=done, console=console)
        self._done = done

    def done(self, number: int, text: str) -> None:
        """One more; what failed is always told, and does not count."""
        has_failed = text.startswith("failed")
        self._done += not has_failed
        self._progress.update(self._done, f"case {number}: {text}", is_told=has_failed)

    def stop(self) -> None:
        """Leave the last state on the screen."""
        self._progress.stop()
