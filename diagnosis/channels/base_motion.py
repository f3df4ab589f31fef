"""How the body moves by what the robot reports; accelerations are the inertial unit's where there is one.

Time convention: packets of the inertial unit are older than their state by their own stamps, and are brought forward.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.channels.stack import Stack
from diagnosis.seam import Array
from spot_model.rotation import rotate_inverse_wxyz, rotate_wxyz

GRAVITY_M_S2: Final = 9.81
GRAVITY_TOLERANCE_M_S2: Final = 2.0
"""The mean vertical reading must be this near to gravity, or to none, to know whether it is in."""


@dataclass(frozen=True)
class BaseMotion:
    """N rows, smoothed."""

    odom_from_body_wxyz: Array
    angular_vel_in_body_rad_s: Array
    angular_acc_in_body_rad_s2: Array
    linear_acc_in_odom_m_s2: Array
    """Of the body's origin, gravity not in."""
    uses_imu: bool


def imu_gravity_m_s2(stack: Stack) -> float | None:
    """Gravity in the inertial unit's readings: 9.81 where it reports the specific force, 0 where the acceleration.

    None where there is no unit, or its mean is neither.
    """
    if not all(r.has("imu.acceleration_m_s2") for r in stack.recordings):
        return None
    attitude = stack.filled(lambda r: r.odom_from_body_wxyz)
    reading = rotate_wxyz(attitude, stack.filled(lambda r: r.imu.acceleration_m_s2))
    if not stack.used.any():
        return None
    mean = float(np.mean(reading[stack.used, 2]))
    for gravity in (GRAVITY_M_S2, 0.0):
        if abs(mean - gravity) < GRAVITY_TOLERANCE_M_S2:
            return gravity
    return None


def imu_acceleration_in_odom_m_s2(stack: Stack, gravity_m_s2: float) -> Array:
    """Smoothed acceleration by the inertial unit at the states' stamps, gravity not in, shape (N, 3)."""
    attitude = stack.filled(lambda r: r.odom_from_body_wxyz)
    reading = rotate_wxyz(attitude, stack.filled(lambda r: r.imu.acceleration_m_s2))
    age_s = stack.recordings[0].imu.age_s
    upright = np.array([0.0, 0.0, gravity_m_s2])
    return np.asarray(stack.smooth(reading) + age_s * stack.rate(reading) - upright)


def base_motion(stack: Stack) -> BaseMotion:
    """The body's motion; its acceleration by the inertial unit, else by differentiating the estimator's velocity."""
    attitude = stack.filled(lambda r: r.odom_from_body_wxyz)
    turn = rotate_inverse_wxyz(attitude, stack.filled(lambda r: r.angular_vel_of_body_in_odom_rad_s))
    gravity = imu_gravity_m_s2(stack)
    smooth_turn, turn_rate = stack.smooth(turn), stack.rate(turn)
    if all(r.has("imu.angular_vel_rad_s") for r in stack.recordings):
        gyro, age_s = stack.filled(lambda r: r.imu.angular_vel_rad_s), stack.recordings[0].imu.age_s
        smooth_turn = stack.smooth(gyro) + age_s * stack.rate(gyro)
        # Not brought forward by its age: that would take a second derivative, and its noise is worse than 1 ms.
        turn_rate = stack.rate(gyro)
    if gravity is None:
        acceleration = stack.rate(stack.filled(lambda r: r.linear_vel_of_body_in_odom_m_s))
    else:
        acceleration = imu_acceleration_in_odom_m_s2(stack, gravity)
    smoothed = stack.smooth(attitude)
    length = np.maximum(np.linalg.norm(smoothed, axis=1, keepdims=True), 1e-9)
    unit = np.where(length > 1e-6, smoothed / length, np.array([1.0, 0.0, 0.0, 0.0]))
    return BaseMotion(
        odom_from_body_wxyz=unit,
        angular_vel_in_body_rad_s=smooth_turn,
        angular_acc_in_body_rad_s2=turn_rate,
        linear_acc_in_odom_m_s2=acceleration,
        uses_imu=gravity is not None,
    )
