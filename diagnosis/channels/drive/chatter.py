"""Stretches in which a joint's velocity rattles: impacts, and feet that skip over the ground.

The load of one instant says little there of the mean acceleration between states, and no filter mends that.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from diagnosis.channels.channel_view import Flags
from diagnosis.channels.stack import Stack

REACH: Final = 9
"""States over which rattling is averaged, the reach of the smoothing filter."""
RATTLE_RAD_S: Final = 0.25
"""Root mean square of a velocity's second difference between states; a new set-point's step makes at most 0.2."""
TIMES_USUAL: Final = 3.0
"""Noisy velocities rattle all the time: only so many times the usual counts."""


def rattling(stack: Stack) -> Flags:
    """Where each joint rattles, shape (N, J)."""
    velocity = stack.filled(lambda r: r.velocity_rad_s)
    second = np.zeros_like(velocity)
    second[1:-1] = velocity[2:] - 2.0 * velocity[1:-1] + velocity[:-2]
    size = np.sqrt(uniform_filter1d(second**2, REACH, axis=0))
    usual = np.median(size[stack.used], axis=0) if stack.used.any() else np.zeros(velocity.shape[1])
    return np.asarray(size > np.maximum(RATTLE_RAD_S, TIMES_USUAL * usual))
