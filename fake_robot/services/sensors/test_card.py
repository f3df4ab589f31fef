"""A test card: what the cameras show where nothing can draw the scene."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_FIELD = 8
"""Pixels of one side of a field."""
_DARK, _LIGHT, _RANGE = 40, 110, 100


@lru_cache(maxsize=4)
def card_pixels(cols: int, rows: int) -> NDArray[np.uint8]:
    """A grey chessboard that gets lighter to the right, inverted at the upper left; shape (rows, cols).

    Up, down, left and right differ.
    """
    width, height = -(-cols // _FIELD), -(-rows // _FIELD)
    y, x = np.mgrid[0:height, 0:width]
    card = np.where((x + y) % 2 == 0, _DARK, _LIGHT) + (x * _RANGE) // max(1, width - 1)
    card[: height // 4, : width // 4] = 255 - card[: height // 4, : width // 4]
    return np.kron(card.astype(np.uint8), np.ones((_FIELD, _FIELD), dtype=np.uint8))[:rows, :cols]
