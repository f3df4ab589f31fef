"""Bring runs to one clock: the shift at which their velocity commands agree best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from compare.errors import DifferentCommandsError, TooShortError
from compare.tracks import LEAST_S, STEP_S, Array, Track

ALLOWED: Final = 0.15
"""Largest difference of the velocity commands (m/s, rad/s) at any instant up to which two runs were told the same."""
AXES: Final = (("forward", "m/s"), ("to the left", "m/s"), ("turning", "rad/s"))
SLIP_S: Final = 0.1
"""A command may come so much earlier or later: five ticks of a policy, which a busy computer may lose."""
STRIDE: Final = 2
"""Shifts are tried every so many samples: commands change with the policy's 50 Hz."""
LEAST_SHARE: Final = 0.5
"""Two runs must overlap by this share of the shorter one."""


def aligned(tracks: Sequence[Track]) -> list[Track]:
    """The stretch that all runs share, each run's samples at the same time under the command.

    Args:
        tracks: The first is the reference.

    Raises:
        DifferentCommandsError: A run was told something else than the first.
        TooShortError: The runs share less than a second.
    """
    reference, *others = tracks
    shifts = [0, *(shift(reference, other) for other in others)]
    begin = max(0, *(-s for s in shifts)) if others else 0
    end = min(len(t) - s for t, s in zip(tracks, shifts, strict=True))
    if (end - begin) * STEP_S < LEAST_S:
        raise TooShortError("what the runs have in common", max(0, end - begin) * STEP_S, LEAST_S)
    return [t.part(slice(begin + s, end + s)) for t, s in zip(tracks, shifts, strict=True)]


def shift(reference: Track, other: Track) -> int:
    """How many samples later ``other`` does what ``reference`` does; the smallest such shift where several agree.

    Raises:
        DifferentCommandsError: At no shift do the commands agree.
    """
    a, b = reference.velocity_command, other.velocity_command
    if np.isnan(a).all() or np.isnan(b).all():
        return 0  # a recording without commands: the starts are aligned
    shortest = round(LEAST_SHARE * min(len(a), len(b)))
    candidates = sorted(range(-(len(a) - shortest), len(b) - shortest + 1, STRIDE), key=abs)
    if 0 not in candidates:
        candidates.insert(0, 0)
    differences = [_difference(a, b, s) for s in candidates]
    best = candidates[int(np.argmin(np.round(differences, 3)))]  # ties: the first, which is the smallest shift
    _check_same(reference, other, best)
    return best


def _overlap(a: Array, b: Array, s: int) -> tuple[Array, Array]:
    begin, end = max(0, -s), min(len(a), len(b) - s)
    return a[begin:end], b[begin + s : end + s]


def _difference(a: Array, b: Array, s: int) -> float:
    first, second = _overlap(a, b, s)
    return float(np.nanmean(np.abs(first - second))) if len(first) else np.inf


def _check_same(reference: Track, other: Track, s: int) -> None:
    """Refuse a run that at any instant was told something else, on any axis; steps may come a little early or late."""
    first, second = _overlap(reference.velocity_command, other.velocity_command, s)
    apart = np.nan_to_num(np.maximum(_beyond(first, second), _beyond(second, first)))
    at, axis = np.unravel_index(int(np.argmax(apart)), apart.shape)
    if apart[at, axis] > ALLOWED:
        at_s = (max(0, -s) + int(at)) * STEP_S
        told = (float(first[at, axis]), float(second[at, axis]))
        raise DifferentCommandsError(reference.name, other.name, at_s, AXES[axis], told, ALLOWED)


def _beyond(command: Array, other: Array) -> Array:
    """How far a command leaves what the other one is about that time, shape (n, 3)."""
    size = 2 * round(SLIP_S / STEP_S) + 1
    low, high = minimum_filter1d(other, size, axis=0), maximum_filter1d(other, size, axis=0)
    return np.asarray(np.maximum(low - command, command - high))
