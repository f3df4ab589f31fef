"""The newest measurements of one quantity, in memory that never grows."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

DEFAULT_CAPACITY: Final = 32_768
"""Ten minutes at 50 Hz."""


class RecentValues:
    """A ring of numbers; when it is full, the oldest goes."""

    def __init__(self, capacity: int = DEFAULT_CAPACITY) -> None:
        self._ring = np.full(capacity, np.nan)
        self.count = 0
        """Numbers taken since the start."""

    def add(self, value: float) -> None:
        """Take a number."""
        self._ring[self.count % self._ring.size] = value
        self.count += 1

    def newest(self, count: int) -> NDArray[np.float64]:
        """The newest numbers, at most ``count`` of them; the order within them is not kept."""
        size = min(count, self.count, self._ring.size)
        places = np.arange(self.count - size, self.count) % self._ring.size
        return self._ring[places]

    def percentile(self, percent: float) -> float:
        """A percentile of what is kept; NaN when nothing is."""
        kept = self._ring[: min(self.count, self._ring.size)]
        return float(np.percentile(kept, percent)) if kept.size else float("nan")
