"""Lines in the spectrum of a residual over the joint's angle: what repeats with the angle, whatever the speed."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.seam import Array, Flags

BIN_RAD: Final = 0.002
LOWEST_PER_RAD: Final = 36.0
HIGHEST_PER_RAD: Final = 700.0
"""Of slower lines the window takes off too much; faster than this the bins cannot follow."""
STEP_PER_RAD: Final = 0.5
WINDOW_BINS: Final = 81
"""What varies more slowly than over this many bins is taken off first."""


def strongest_orders(position_rad: Array, residual: Array, usable: Flags, n: int = 4) -> tuple[float, ...]:
    """The ``n`` orders (cycles of phase per rad of joint) with the most power, joints taken together.

    Args:
        position_rad: Shape (m, J).
        residual: Shape (m, J).
        usable: Shape (m, J).
        n: How many.
    """
    orders = np.arange(LOWEST_PER_RAD, HIGHEST_PER_RAD, STEP_PER_RAD)
    power = np.zeros(len(orders))
    for joint in range(position_rad.shape[1]):
        good = usable[:, joint]
        if good.sum() < 50:
            continue
        # Outliers would be a comb of their own.
        values = residual[good, joint]
        values = values - np.median(values)
        bound = 4.0 * 1.4826 * float(np.median(np.abs(values))) + 1e-9
        values = np.clip(values, -bound, bound)
        angle = position_rad[good, joint]
        first = float(angle.min())
        number = np.round((angle - first) / BIN_RAD).astype(np.intp)
        sums, counts = np.bincount(number, values), np.bincount(number)
        window = np.ones(min(WINDOW_BINS, 2 * ((len(sums) - 1) // 2) + 1))
        smooth = np.convolve(sums, window, mode="same") / np.maximum(np.convolve(counts, window, mode="same"), 1.0)
        sums = sums - smooth * counts
        centres = first + BIN_RAD * np.arange(len(sums))
        waves = np.exp(-1j * np.outer(orders, centres))
        power += np.abs(waves @ sums) ** 2 / (float(np.sum(values**2)) * 1.0 + 1e-12)
    chosen: list[float] = []
    for index in np.argsort(power)[::-1]:
        order = float(orders[index])
        if all(abs(order - other) > 3.0 for other in chosen):
            chosen.append(order)
        if len(chosen) == n:
            break
    return tuple(chosen)
