"""Bring runs to one clock: the shift at which their velocity commands agree best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from compare.errors import DifferentCommandsError, TooShortError
from compare.tracks import LEAST_S, STEP_S, Track

ALLOWED: Final = 0.15
"""Mean difference of the velocity commands (m/s, rad/s) up to which two runs count as told the same."""
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
    best = int(np.argmin(np.round(differences, 3)))  # ties: the first, which is the smallest shift
    if not differences[best] <= ALLOWED:
        raise DifferentCommandsError(reference.name, other.name, differences[best], ALLOWED)
    return candidates[best]


def _difference(a: np.ndarray, b: np.ndarray, s: int) -> float:
    begin, end = max(0, -s), min(len(a), len(b) - s)
    return float(np.nanmean(np.abs(a[begin:end] - b[begin + s : end + s]))) if end > begin else np.inf
