"""How far a diagnosis is: stage, share, time left. One line that renews itself on a terminal, else lines."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, TextIO

from spot_model.io.progress import PLAIN_INTERVAL_S

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
RENEW_S: Final = 0.3
"""Of a terminal's line; elsewhere the text is said again every so often."""
BAR: Final = 20


class Progress:
    """Says how far it is. Calling it with a text says the text; the text of a stage begins that stage.

    Args:
        stream: Where it goes.
        clock: Seconds, for the time left.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream, clock
        self._is_terminal = stream.isatty()
        self._began_s = self._shown_s = clock()
        self._first, self._last = 0.0, 0.0
        self._text = ""
        self.share = 0.0

    def __call__(self, text: str) -> None:
        """Say something."""
        before = 0.0
        for begin, share in STAGES:
            if text.startswith(begin):
                self._first, self._last = before, before + share
                self.share = max(self.share, before)
                break
            before += share
        else:
            self.share += WITHIN * max(0.0, self._last - self.share)
        self._text = text
        self._show()

    def at(self, share: float) -> None:
        """The present stage is this far, 0 to 1."""
        self.share = max(self.share, self._first + share * (self._last - self._first))
        if self._clock() - self._shown_s >= (RENEW_S if self._is_terminal else PLAIN_INTERVAL_S):
            self._show()

    def close(self) -> None:
        """Nothing more will be said."""
        if self._is_terminal:
            self._stream.write("\r\x1b[2K")
            self._stream.flush()

    @property
    def left_s(self) -> float | None:
        """Time left as the share suggests; None at first."""
        elapsed_s = self._clock() - self._began_s
        return elapsed_s * (1.0 - self.share) / self.share if self.share >= 0.05 else None

    def _show(self) -> None:
        self._shown_s = self._clock()
        elapsed_s, left_s = self._shown_s - self._began_s, self.left_s
        left = "" if left_s is None else f", about {_words(left_s)} left"
        if self._is_terminal:
            done = round(BAR * self.share)
            bar = "█" * done + "░" * (BAR - done)
            self._stream.write(
                f"\r\x1b[2K{bar} {100 * self.share:3.0f} %  {_words(elapsed_s)}{left}  {self._text[:70]}"
            )
        else:
            self._stream.write(f"[{elapsed_s:5.1f} s, {100 * self.share:3.0f} %{left}] {self._text}\n")
        self._stream.flush()


def _words(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} min" if minutes else f"{rest} s"
