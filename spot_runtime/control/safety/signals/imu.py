"""Attitude and turn rate against the inertial unit, which feels gravity and turns with the body."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window, length, turned_rad

_NOTHING = np.zeros(3)


class ImuMemory(NamedTuple):
    """What the unit measured recently."""

    force_m_s2: Array = _NOTHING
    """Specific force in odom less the body's acceleration, summed over a time that fades. Shape (3,), m/s² · s."""
    felt_s: float = 0.0
    """That time."""
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


def after_window(memory: ImuMemory, window: Window) -> ImuMemory:
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
