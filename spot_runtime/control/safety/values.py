"""Numbers of joints, judged together; on lists, which are faster than arrays of this size."""

from __future__ import annotations

import math
from operator import ge, le
from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import Array

_LOWS_RAD: Final = facts.POSITION_LOW_RAD.tolist()
_HIGHS_RAD: Final = facts.POSITION_HIGH_RAD.tolist()


def are_finite(*arrays: Array) -> bool:
    """Whether all values are: their sum is not as soon as one of them is not."""
    return math.isfinite(sum(map(sum, map(np.ndarray.tolist, arrays))))


def is_between(least_rad: Array, largest_rad: Array) -> bool:
    """Whether, joint by joint, one value is at most the upper stop and the other at least the lower. Shapes (12,)."""
    return all(map(le, least_rad.tolist(), _HIGHS_RAD)) and all(map(ge, largest_rad.tolist(), _LOWS_RAD))
