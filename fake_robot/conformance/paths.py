"""Paths and their rates: whether one is the other's slope, and whether two motions are of one time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fake_robot.conformance.server import OpenError
from spot_model.robot.facts import Array
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz

_STRAY = 0.35
"""Share of a path by which rates may miss it: estimators are a tenth off, a wrong sign, unit or frame is more."""
_SCALE = (0.8, 1.25)
"""A path over the integral of its rate: estimators are a tenth off."""
_SEARCH_S, _SPAN = 0.1, 4


def edges(stamps_s: Array, piece_s: float) -> Array:
    """Rows between which pieces of about ``piece_s`` lie."""
    if len(stamps_s) < 2:
        raise OpenError("too few states came")
    if stamps_s[-1] <= stamps_s[0]:
        raise OpenError("the stamps stand still")
    count = max(1, round(float(stamps_s[-1] - stamps_s[0]) / piece_s))
    return np.unique(
        np.searchsorted(stamps_s, np.linspace(stamps_s[0], stamps_s[-1], count + 1)).clip(max=len(stamps_s) - 1)
    )


def strays(stamps_s: Array, rate: Array, edges: Array, path: Array, least: float) -> bool:
    """Whether the path, shape (pieces, n), differs from the integral of its rate by ``_STRAY`` of its length.

    So does one that differs in the scale of a part that travels by more than ``least``.
    """
    travelled = np.array([np.trapezoid(rate[a : b + 1], stamps_s[a : b + 1], axis=0) for a, b in pairwise(edges)])
    off, way = (float(np.linalg.norm(part, axis=1).sum()) for part in (path - travelled, path))
    moves = np.abs(path).sum(axis=0) > least
    scale = (path * travelled).sum(axis=0)[moves] / (np.square(travelled).sum(axis=0)[moves] + 1e-12)
    return bool(off > max(_STRAY * way, least) or np.any((scale < _SCALE[0]) | (scale > _SCALE[1])))


def slope(stamps_s: Array, values: Array) -> Array:
    """The rate of a path over some messages, shape (n, m), without a shift in time."""
    rows = np.arange(len(stamps_s))
    before, after = (rows - _SPAN).clip(min=0), (rows + _SPAN).clip(max=len(rows) - 1)
    return np.asarray((values[after] - values[before]) / (stamps_s[after] - stamps_s[before])[:, None])


def late_s(stamps_s: Array, seen: Array, known_s: Array, known: Array) -> float:
    """By how much ``seen`` lags behind ``known``, each of shape (n, m): the shift at which they are most alike."""
    shifts_s = np.arange(-_SEARCH_S, _SEARCH_S + 1e-9, 4e-3)
    inside = (stamps_s > known_s[0] + _SEARCH_S) & (stamps_s < known_s[-1] - _SEARCH_S)
    if inside.sum() < 2:
        raise OpenError("too few states came")
    moved = [np.array([np.interp(stamps_s[inside] - s, known_s, column) for column in known.T]) for s in shifts_s]
    scale = known.std(axis=0)[:, None] + 1e-9
    return float(shifts_s[np.argmin([(np.square(m - seen[inside].T) / scale**2).mean() for m in moved])])


def turns(wxyz: Array) -> Array:
    """The small turns from each attitude to the next, as rotation vectors in the turning frame; rad."""
    turn = multiply_wxyz(conjugate_wxyz(wxyz[:-1]), wxyz[1:])
    return np.asarray(2.0 * turn[:, 1:] * np.sign(turn[:, :1]))


def angle(a_wxyz: Array, b_wxyz: Array) -> Array:
    """Between attitudes, rad."""
    return np.asarray(2.0 * np.arccos(np.abs((a_wxyz * b_wxyz).sum(axis=-1)).clip(max=1.0)))
