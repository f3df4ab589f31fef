"""Rates against what they are rates of, and the body against its inertial unit.

Joint velocity is compared with position, turn rate with attitude, both also with the unit's own packets.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window, length, turned_rad

_MEMORIES_S = np.array([[bounds.SLOPE_MEMORY_S], [bounds.DRIFT_MEMORY_S]])
_BOUNDS_RAD = np.array([[bounds.SLOPE_RAD], [bounds.DRIFT_RAD]])
_NO_SLOPES = np.zeros((len(_MEMORIES_S), facts.N_JOINTS))
_NO_COUNTS = np.zeros(facts.N_JOINTS, dtype=np.int64)
_NO_TURN = np.zeros(3)


class MotionMemory(NamedTuple):
    """Differences between measured and integrated motion, and what a lag makes of them. All of it fades.

    That of joints fades at two rates, in rows: shape (2, 12).
    """

    slope_rad: Array = _NO_SLOPES
    change_rad_s: Array = _NO_SLOPES
    """Change of each joint's velocity."""
    blur_rad: Array = _NO_SLOPES
    """The most that a window leaves open: the bend of a lag, and holes between states."""
    slope_windows: NDArray[np.int64] = _NO_COUNTS
    """In a row, beyond either bound. Shape (12,)."""
    turn_rad: Array = _NO_TURN
    """Shape (3,), odom."""
    turn_change_rad_s: Array = _NO_TURN
    """Change of the turn rate. Shape (3,), odom."""
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
    fades = np.maximum(0.0, 1.0 - window.duration_s / _MEMORIES_S)
    moved = last.position_rad - first.position_rad
    slope = memory.slope_rad * fades + (moved - window.travel_rad)
    change = memory.change_rad_s * fades + (last.velocity_rad_s - first.velocity_rad_s)
    # In a hole a rate may have been any of those at its ends.
    open_s = 0.5 * window.hole_s
    blur = np.maximum(memory.blur_rad * fades, (bounds.SLOPE_BEND_S + open_s) * window.velocity_range_rad_s)
    allowed = _BOUNDS_RAD + bounds.SLOPE_LAG_S * np.abs(change) + blur
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
        np.where((np.abs(slope) > allowed).any(axis=0), memory.slope_windows + 1, 0),
        turn,
        turn_change,
        turn_blur,
        memory.turn_windows + 1 if length(turn) > turn_allowed else 0,
    )


_NOTHING = np.zeros(3)


class ImuMemory(NamedTuple):
    """What the unit measured recently."""

    force_m_s2: Array = _NOTHING
    """Specific force in odom less the body's acceleration, summed over a time that fades. Shape (3,), m/s² · s."""
    felt_s: float = 0.0
    """Time over which the force is summed; it fades as the sum does, s."""
    angle_windows: int = 0
    turn_rate_windows: int = 0
    unknown_windows: int = 0
    """In a row with a packet that holds what is no number."""
    stamp_windows: int = 0
    """In a row in which the newest packet was not of the time of its message."""
    stamp_error_s: float = 0.0
    """By how much, in the newest window."""
    silent_windows: int = 0
    """In a row without a packet, of a unit that has reported."""
    has_reported: bool = False

    @property
    def tilt_error_rad(self) -> float:
        """Angle between what was felt and the vertical; 0 until enough was felt, or where gravity is not reported."""
        x, y, z = self.force_m_s2.tolist()
        is_gravity = length(self.force_m_s2) >= bounds.GRAVITY_LEAST_M_S2 * self.felt_s
        if self.felt_s < 0.25 * bounds.GRAVITY_MEMORY_S or not is_gravity:
            return 0.0
        return math.atan2(math.hypot(x, y), z)


def after_imu_window(memory: ImuMemory, window: Window) -> ImuMemory:
    """The memory after one more window; where no packet ever came, nothing is judged."""
    if not window.imu:
        return memory._replace(silent_windows=memory.silent_windows + memory.has_reported)
    packets, last = window.imu, window.last
    force = np.mean([packet.acceleration_of_imu_in_link_m_s2 for packet in packets], axis=0)
    turn_rate = np.mean([packet.angular_vel_of_link_in_link_rad_s for packet in packets], axis=0)
    attitude = packets[-1].odom_from_link_wxyz
    if not np.isfinite(np.concatenate([force, turn_rate, attitude])).all():
        return memory._replace(unknown_windows=memory.unknown_windows + 1, silent_windows=0, has_reported=True)
    force_m_s2, felt_s = memory.force_m_s2, memory.felt_s
    if window.hole_s <= bounds.GRAVITY_HOLE_S:
        force_m_s2, felt_s = _felt(memory, window, force)
    # Where the unit reports no attitude of its own, there is nothing to compare.
    angle = length(turned_rad(last.odom_from_body_wxyz, attitude)) if attitude.any() else 0.0
    expected = window.turn_rad / window.duration_s
    rate_error = length(window.odom_from_body @ turn_rate - expected) - bounds.IMU_TURN_RATE_SHARE * length(expected)
    stamp_error_s = (packets[-1].robot_stamp_ns - last.robot_stamp_ns) / NS_PER_S
    return ImuMemory(
        force_m_s2,
        felt_s,
        memory.angle_windows + 1 if angle > bounds.IMU_ANGLE_RAD else 0,
        memory.turn_rate_windows + 1 if rate_error > bounds.IMU_TURN_RATE_RAD_S else 0,
        stamp_windows=memory.stamp_windows + 1 if abs(stamp_error_s) > bounds.IMU_STAMP_S else 0,
        stamp_error_s=stamp_error_s,
        has_reported=True,
    )


def _felt(memory: ImuMemory, window: Window, force_m_s2: Array) -> tuple[Array, float]:
    """The specific force and the time in which it was felt, after one more window."""
    first, last = window.first, window.last
    gained = last.linear_vel_of_body_in_odom_m_s - first.linear_vel_of_body_in_odom_m_s
    fade = max(0.0, 1.0 - window.duration_s / bounds.GRAVITY_MEMORY_S)
    felt = memory.force_m_s2 * fade + window.odom_from_body @ force_m_s2 * window.duration_s - gained
    return felt, memory.felt_s * fade + window.duration_s
