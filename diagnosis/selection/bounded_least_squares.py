"""Least squares within bounds, for many small problems at once, from their normal equations."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.channel_view import Array

SWEEPS: Final = 60
RIDGE: Final = 1e-9


def solve_bounded(gram: Array, right: Array, low: Array, high: Array) -> Array:
    """Minimise ½ bᵀGb − rᵀb within bounds.

    Args:
        gram: Shape (..., k, k), symmetric, positive semi-definite.
        right: Shape (..., k).
        low: Shape (k,).
        high: Shape (k,), may equal ``low``.

    Returns:
        Shape (..., k). A column of zeros gets the bound nearest to 0.
    """
    k = gram.shape[-1]
    if k == 0:
        return np.zeros_like(right)
    diagonal = np.einsum("...ii->...i", gram)
    scale = np.sqrt(np.maximum(diagonal, 1e-30))
    unit = gram / (scale[..., :, None] * scale[..., None, :]) + RIDGE * np.eye(k)
    target = right / scale
    b_low, b_high = low * scale, high * scale
    b = np.linalg.solve(unit, target[..., None])[..., 0]
    if np.all((b >= b_low) & (b <= b_high)):
        return np.asarray(b / scale)
    b = np.clip(b, b_low, b_high)
    for _ in range(SWEEPS):
        before = b.copy()
        for i in range(k):
            slope = target[..., i] - np.einsum("...j,...j->...", unit[..., i, :], b)
            b[..., i] = np.clip(b[..., i] + slope / unit[..., i, i], b_low[..., i], b_high[..., i])
        if np.max(np.abs(b - before)) < 1e-7 * (1.0 + np.max(np.abs(b))):
            break
    return np.asarray(b / scale)
