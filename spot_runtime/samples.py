"""The newest measurements of one quantity, in memory that never grows."""

from __future__ import annotations

from typing import Final

import numpy as np

DEFAULT_CAPACITY: Final = 32_768
"""Ten minutes at 50 Hz."""


class Samples:
    """A ring of numbers; when it is full, the oldest goes."""

    def __init__(self, capacity: int = DEFAULT_CAPACITY) -> None:
        """Allocate, and touch, all memory now."""
        self._ring = np.full(capacity, np.nan)
        self.count = 0
        """Numbers taken since the start."""

    def add(self, value: float) -> None:
        """Take a number."""
        self._ring[self.count % self._ring.size] = value
        self.count += 1

    def percentile(self, percent: float) -> float:
        """A percentile of what is kept; NaN when nothing is."""
        kept = self._ring[: min(self.count, self._ring.size)]
        return float(np.percentile(kept, percent)) if kept.size else float("nan")
