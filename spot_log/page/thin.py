"""Fewer points for a plot, without losing a peak."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray


def thin_rows(values: NDArray[Any], max_points: int) -> NDArray[np.int64]:
    """Choose rows of a signal to draw: the smallest and the largest of each of ``max_points``/2 equal stretches.

    Args:
        values: Signal, shape (n,); NaN is never chosen as a peak.
        max_points: How many rows at most, >= 4.

    Returns:
        Rising row numbers, at most ``max_points``; all rows where there are no more, first and last always among them.
    """
    n = len(values)
    if n <= max_points:
        return np.arange(n)
    edges = np.linspace(0, n, max_points // 2, dtype=np.int64)
    low = np.where(np.isnan(values), np.inf, values)
    high = np.where(np.isnan(values), -np.inf, values)
    rows = [0, n - 1]
    for a, b in pairwise(edges):
        rows += [int(a + low[a:b].argmin()), int(a + high[a:b].argmax())]
    return np.unique(rows)
