"""Rates against what they are rates of: joint velocity against position, turn rate against attitude."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.state import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window, length, turned_rad

_NO_JOINTS = np.zeros(facts.N_JOINTS)
_NO_COUNTS = np.zeros(facts.N_JOINTS, dtype=np.int64)
_NO_TURN = np.zeros(3)


class MotionMemory(NamedTuple):
    """Differences between measured and integrated motion, and what a lag makes of them. All of it fades."""

    slope_rad: Array = _NO_JOINTS
    """Shape (12,)."""
    change_rad_s: Array = _NO_JOINTS
    """Of each joint's velocity. Shape (12,)."""
    blur_rad: Array = _NO_JOINTS
    """The most that a window leaves open: the bend of a lag, and holes between states. Shape (12,)."""
    slope_windows: NDArray[np.int64] = _NO_COUNTS
    """In a row, beyond the bound."""
    turn_rad: Array = _NO_TURN
    """Shape (3,), odom."""
    turn_change_rad_s: Array = _NO_TURN
    """Of the turn rate. Shape (3,), odom."""
    turn_blur_rad: float = 0.0
    turn_windows: int = 0


def resting(window: Window) -> NDArray[np.bool_]:
    """Joints whose position and velocity agree over a window, so that either may repeat its value. Shape (12,).

    At a stop, in stiction or as it turns round, a joint stands still for long though others move. If one of its two
    signals is frozen, the other tells of a motion that the first does not show.
    """
    missed = np.abs(window.last.position_rad - window.first.position_rad - window.travel_rad)
    return np.asarray(missed <= bounds.SLOPE_RAD * window.duration_s / bounds.SLOPE_MEMORY_S)


def after_window(memory: MotionMemory, window: Window) -> MotionMemory:
    """The memory after one more window."""
    first, last = window.first, window.last
    fade = max(0.0, 1.0 - window.duration_s / bounds.SLOPE_MEMORY_S)
    moved = last.position_rad - first.position_rad
    slope = memory.slope_rad * fade + (moved - window.travel_rad)
    change = memory.change_rad_s * fade + (last.velocity_rad_s - first.velocity_rad_s)
    # In a hole a rate may have been any of those at its ends.
    open_s = 0.5 * window.hole_s
    blur = np.maximum(memory.blur_rad * fade, (bounds.SLOPE_BEND_S + open_s) * window.velocity_range_rad_s)
    allowed = bounds.SLOPE_RAD + bounds.SLOPE_LAG_S * np.abs(change) + blur
    fade = max(0.0, 1.0 - window.duration_s / bounds.TURN_MEMORY_S)
    turn = turned_rad(first.odom_from_body_wxyz, last.odom_from_body_wxyz) - window.turn_rad
    turn = memory.turn_rad * fade + turn
    turn_change = memory.turn_change_rad_s * fade
    turn_change = turn_change + (last.angular_vel_of_body_in_odom_rad_s - first.angular_vel_of_body_in_odom_rad_s)
    turn_blur = max(memory.turn_blur_rad * fade, (bounds.TURN_BEND_S + open_s) * window.turn_rate_range_rad_s)
    turn_allowed = bounds.TURN_RAD + bounds.TURN_LAG_S * length(turn_change) + turn_blur
    return MotionMemory(
        slope,
        change,
        blur,
        np.where(np.abs(slope) > allowed, memory.slope_windows + 1, 0),
        turn,
        turn_change,
        turn_blur,
        memory.turn_windows + 1 if length(turn) > turn_allowed else 0,
    )
