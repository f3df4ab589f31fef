"""Rates against what they are rates of: joint velocity against position, turn rate against attitude."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.state import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window, turned_rad

_NO_JOINTS = np.zeros(facts.N_JOINTS)
_NO_COUNTS = np.zeros(facts.N_JOINTS, dtype=np.int64)
_NO_TURN = np.zeros(3)


class MotionMemory(NamedTuple):
    """Differences between measured and integrated motion, which fade."""

    slope_rad: Array = _NO_JOINTS
    """Shape (12,)."""
    range_rad_s: Array = _NO_JOINTS
    """Over which each velocity has moved of late. Shape (12,)."""
    slope_windows: NDArray[np.int64] = _NO_COUNTS
    """In a row, beyond the bound."""
    turn_rad: Array = _NO_TURN
    """Shape (3,), odom."""
    turn_rate_range_rad_s: float = 0.0
    turn_windows: int = 0


def after_window(memory: MotionMemory, window: Window) -> MotionMemory:
    """The memory after one more window."""
    fade = max(0.0, 1.0 - window.duration_s / bounds.SLOPE_MEMORY_S)
    moved = window.last.position_rad - window.first.position_rad
    slope = memory.slope_rad * fade + (moved - window.travel_rad)
    ranges = np.maximum(memory.range_rad_s * fade, window.velocity_range_rad_s)
    is_beyond = np.abs(slope) > bounds.SLOPE_RAD + bounds.SLOPE_LAG_S * ranges
    fade = max(0.0, 1.0 - window.duration_s / bounds.TURN_MEMORY_S)
    turn = turned_rad(window.first.odom_from_body_wxyz, window.last.odom_from_body_wxyz) - window.turn_rad
    turn = memory.turn_rad * fade + turn
    turn_range = max(memory.turn_rate_range_rad_s * fade, window.turn_rate_range_rad_s)
    is_turned = float(np.sqrt(turn @ turn)) > bounds.TURN_RAD + bounds.TURN_LAG_S * turn_range
    return MotionMemory(
        slope,
        ranges,
        np.where(is_beyond, memory.slope_windows + 1, 0),
        turn,
        turn_range,
        memory.turn_windows + 1 if is_turned else 0,
    )
