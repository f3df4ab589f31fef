"""How far a diagnosis is: its stages as shares of one hundred, on the bar that all long work shows."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from rich.console import Console

from spot_model.io import progress

STAGES: Final = (
    ("reading logs", 0.10),
    ("building channels", 0.15),
    ("trying", 0.35),
    ("simulating the models", 0.35),
    ("writing the report", 0.05),
)
"""How the first message of each stage begins, and its usual share of the time."""
WITHIN: Final = 0.25
"""A message within a stage of unknown length goes this share of what is left of it."""


class Progress(progress.Progress):
    """Says how far it is. Calling it with a text says the text; the text of a stage begins that stage.

    It goes to ``console``, standard error by default; ``clock`` gives seconds, for the time left.
    """

    def __init__(self, console: Console | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        console = console or Console(stderr=True)
        super().__init__("diagnosis", console=console, clock=clock)
        self._has_lines = not console.is_terminal
        self._begin, self._end = 0.0, 0.0
        self._text = ""
        self.share = 0.0

    def __call__(self, text: str) -> None:
        """Say something."""
        before = 0.0
        for begin, share in STAGES:
            if text.startswith(begin):
                self._begin, self._end = before, before + share
                self.share = max(self.share, before)
                break
            before += share
        else:
            self.share += WITHIN * max(0.0, self._end - self.share)
        self._text = text
        self.update(round(100 * self.share), text, is_told=self._has_lines)

    def at(self, share: float) -> None:
        """The present stage is this far, 0 to 1."""
        self.share = max(self.share, self._begin + share * (self._end - self._begin))
        self.update(round(100 * self.share), self._text)

    close = progress.Progress.stop
