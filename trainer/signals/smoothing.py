"""One smoothing kernel for every response and every regressor, and its exact derivative.

A raised-cosine kernel and its derivative over the band that it passes: ``rate(x)`` is the derivative of
``smooth(x)``, so a relation between a signal and another one's derivative keeps its coefficient without bias.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d, minimum_filter1d

from spot_model.robot.facts import Array
from trainer.signals.recording import GRID_TOLERANCE, Flags, Stamps

Rows = slice | NDArray[np.intp]
"""Some rows of a signal, in order."""

REACH: Final = 4
"""Samples on either side that a smoothed value depends on: 12 ms on a 3 ms stream; half amplitude at 42 Hz."""

LONGEST_PERIOD_S: Final = 0.01
"""A leg swings within 0.2 s, and its acceleration turns twice meanwhile: nine states, the filter's reach, must not
span more than half of that."""

_AT = np.arange(-REACH, REACH + 1)
_KERNEL = (1.0 + np.cos(np.pi * _AT / REACH)) / (2.0 * REACH)
_BAND_RAD = np.linspace(0.02, 1.3, 64)
"""Angles per sample over which the derivative must match, up to 70 Hz on a 3 ms stream."""


_RESPONSE = _BAND_RAD * (_KERNEL @ np.cos(np.outer(_AT, _BAND_RAD)))
_TAPS = np.linalg.lstsq(2.0 * np.sin(np.outer(_BAND_RAD, _AT[REACH + 1 :])), _RESPONSE, rcond=None)[0]
_DERIVATIVE = -np.concatenate([-_TAPS[::-1], [0.0], _TAPS])
"""Antisymmetric taps whose response is iω times the kernel's, by least squares over the band."""
NOISE_GAIN: Final = float(np.sqrt(np.sum(_KERNEL**2)))
"""Standard deviation of smoothed white noise over that of the noise."""


def smooth(signal: Array, at: Rows | None = None) -> Array:
    """Weighted mean over the kernel along the first axis, of all rows or those of ``at``. A NaN spreads over it."""
    return _filtered(signal, _KERNEL, at)


def windows(n: int, at: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows of a signal of ``n`` rows that each smoothed value at ``at`` depends on, shape (len(at), 2·REACH + 1)."""
    return np.asarray(np.clip(at[:, None] + _AT, 0, n - 1))


def smooth_windows(values: Array) -> Array:
    """:func:`smooth` of what stands at the rows of :func:`windows`, shape (m, 2·REACH + 1, ...) to (m, ...)."""
    return np.asarray(np.tensordot(_KERNEL, values, axes=(0, 1)))


def rate(signal: Array, period_s: float, at: Rows | None = None) -> Array:
    """Derivative of :func:`smooth` along the first axis, per second, of all rows or those of ``at``."""
    return _filtered(signal, _DERIVATIVE, at) / period_s


def rate_over(signal: Array, stamps_ns: Stamps) -> Array:
    """:func:`rate` of rows at rising instants; where their steps are uneven, by a cubic spline through the rows."""
    if is_even(stamps_ns):
        return rate(signal, float(np.median(np.diff(stamps_ns))) * 1e-9)
    instants_s = (stamps_ns - stamps_ns[0]) * 1e-9
    return smooth(CubicSpline(instants_s, signal)(instants_s, 1))


def is_even(stamps_ns: Stamps) -> bool:
    """Whether all steps are of one length, but for what a grid tolerates."""
    steps = np.diff(stamps_ns) / np.median(np.diff(stamps_ns))
    return bool(np.abs(steps - 1.0).max() <= GRID_TOLERANCE)


def _filtered(signal: Array, taps: Array, at: Rows | None) -> Array:
    signal = np.asarray(signal, dtype=np.float64)
    if at is None:
        return np.asarray(convolve1d(signal, taps, axis=0, mode="nearest"))
    n = len(signal)
    padded = np.concatenate([np.repeat(signal[:1], REACH, axis=0), signal, np.repeat(signal[-1:], REACH, axis=0)])
    out = np.zeros_like(padded[:n][at])
    # Convolution flips the kernel.
    for shift, tap in enumerate(taps[::-1]):
        out += tap * padded[shift : shift + n][at]
    return out


def eroded(flags: Flags, before: int, after: int) -> Flags:
    """True where flags of shape (n, ...) hold from ``before`` rows earlier to ``after`` later; ends count as false."""
    size = before + after + 1
    # The filter's centre lies at size // 2; the origin moves it so that `before` rows lie before.
    origin = before - size // 2
    return np.asarray(minimum_filter1d(flags, size, axis=0, mode="constant", cval=0, origin=origin))


def too_coarse(period_s: float) -> str:
    """Why accelerations cannot be had from states so far apart; empty if they can."""
    if period_s <= LONGEST_PERIOD_S:
        return ""
    return f"a state every {1e3 * period_s:.0f} ms says too little of accelerations"
