"""The state estimator believes that standing feet do not move.

A real robot does not know its velocity. Its estimator integrates the accelerometer, and feet that are taken to stand
still pull the integral back: every give of the ground, every roll and slip of a foot ends up in the velocity that the
policy sees. A simulation that shows the policy the true velocity is another closed loop.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from array_api_compat import device

from spot_model.effects.base import BodyEstimate, Draws, EstimateEffect, JointReading, Memory, parameter
from spot_model.robot import facts
from spot_model.robot.arrays import namespace_of
from spot_model.robot.leg_kinematics import hip_placement
from spot_model.robot.rotation import AnyArray, rotate_inverse_wxyz

VectorInBody = tuple[Any, Any, Any]
"""Three components, each an array of its own: many small arrays cost by the call."""

STANDS_AFTER_S: Final = 0.025
"""A foot that has just touched down still moves, and estimators leave it out."""
_THIGH_X_M, _, _THIGH_Z_M = facts.KN_FROM_HY_M
_SHANK_X_M, _, _SHANK_Z_M = facts.FOOT_FROM_KN_M


@dataclass(frozen=True, kw_only=True)
class LegOdometry(EstimateEffect):
    """A complementary filter: the accelerometer in the short run, standing feet in the long run.

    With v the true velocity, the estimate is v + e, and de/dt = −(u + e)/T. Here u is the mean velocity of the standing
    feet's lowest points, by joints, gyroscope and attitude as the robot has them. Where feet truly stand, e vanishes.

    Source: legged odometry, T of 0.03 to 0.15 s.
    """

    name: ClassVar[str] = "leg_odometry"

    time_s: Any = parameter(null=0.0, low=0.0, high=2.0, unit="s", source="filters of 0.03 to 0.15 s")
    """T; 0 for a velocity that is true."""

    def start(self, estimate: BodyEstimate) -> Memory:
        """No error in the world frame, shape (n, 3), and no foot on the ground, in s, shape (n, 4)."""
        velocity = estimate.linear_vel_of_body_in_body_m_s
        zeros_like = namespace_of(velocity).zeros_like
        return zeros_like(velocity), zeros_like(estimate.foot_contact)

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """Move the error on, and add it to the velocity."""
        error, on_s = memory
        xp = namespace_of(error)
        time_s = self.time_s[:, :1]
        pull = xp.where(time_s > 0.0, -xp.expm1(-dt_s / xp.where(time_s > 0.0, time_s, math.inf)), 0.0)
        on_s = xp.where(estimate.foot_contact > 0.5, on_s + dt_s, 0.0)
        stands = on_s > STANDS_AFTER_S
        count = xp.sum(xp.astype(stands, error.dtype), axis=1, keepdims=True)
        velocity = foot_velocity_m_s(
            estimate.world_from_body_wxyz,
            estimate.linear_vel_of_body_in_body_m_s,
            estimate.angular_vel_of_body_in_body_rad_s,
            joints.position_rad,
            joints.velocity_rad_s,
        )
        mean = xp.sum(xp.where(stands[..., None], velocity, 0.0), axis=1) / xp.clip(count, 1.0, None)
        error = error - xp.where(count > 0.0, pull * (mean + error), 0.0)
        shift = rotate_inverse_wxyz(estimate.world_from_body_wxyz, error)
        velocity_m_s = estimate.linear_vel_of_body_in_body_m_s + shift
        return dataclasses.replace(estimate, linear_vel_of_body_in_body_m_s=velocity_m_s), (error, on_s)


def foot_velocity_m_s(
    world_from_body_wxyz: AnyArray,
    linear_vel_in_body_m_s: AnyArray,
    angular_vel_in_body_rad_s: AnyArray,
    position_rad: AnyArray,
    velocity_rad_s: AnyArray,
) -> AnyArray:
    """Velocity of the feet's lowest points, world frame, by what the robot knows of its joints; shape (n, 4, 3).

    Component by component, since many small arrays cost by the call.
    """
    xp = namespace_of(position_rad)
    hip_x, hip_y, out = hip_placement(xp, position_rad.dtype, device(position_rad))
    w, x, y, z = (world_from_body_wxyz[:, i : i + 1] for i in range(4))
    attitude = (x, y, z)
    # The lowest point lies the foot's radius below its centre.
    down = (-2.0 * (z * x - w * y), -2.0 * (w * x + z * y), -1.0 + 2.0 * (x * x + y * y))
    arm_x, arm_y, arm_z = (facts.FOOT_RADIUS_M * d for d in down)
    hx, hy, kn = (position_rad[:, joint::3] for joint in range(3))
    cos_hx, sin_hx = xp.cos(hx), xp.sin(hx)
    thigh_x, thigh_z = _in_plane(xp, hy, _THIGH_X_M, _THIGH_Z_M)
    shank_x, shank_z = _in_plane(xp, hy + kn, _SHANK_X_M, _SHANK_Z_M)
    leg_x, leg_z = thigh_x + shank_x, thigh_z + shank_z
    foot_y, foot_z = out * cos_hx - leg_z * sin_hx, out * sin_hx + leg_z * cos_hx
    point = (hip_x + leg_x + arm_x, hip_y + foot_y + arm_y, foot_z + arm_z)
    # Two joints turn about the same axis, (0, cos hx, sin hx).
    turned_x, turned_y, turned_z = cos_hx * arm_z - sin_hx * arm_y, sin_hx * arm_x, cos_hx * arm_x
    rate_hx, rate_hy, rate_kn = (velocity_rad_s[:, joint::3] for joint in range(3))
    by_joints = (
        (leg_z + turned_x) * rate_hy + (shank_z + turned_x) * rate_kn,
        -(foot_z + arm_z) * rate_hx + (leg_x * sin_hx + turned_y) * rate_hy + (shank_x * sin_hx + turned_y) * rate_kn,
        (foot_y + arm_y) * rate_hx + (-leg_x * cos_hx - turned_z) * rate_hy + (-shank_x * cos_hx - turned_z) * rate_kn,
    )
    by_turn = _cross(_columns(angular_vel_in_body_rad_s), point)
    own = _columns(linear_vel_in_body_m_s)
    in_body = (
        own[0] + by_turn[0] + by_joints[0],
        own[1] + by_turn[1] + by_joints[1],
        own[2] + by_turn[2] + by_joints[2],
    )
    return xp.stack(_turned(w, attitude, in_body), axis=-1)


def _columns(vector: AnyArray) -> VectorInBody:
    return vector[:, 0:1], vector[:, 1:2], vector[:, 2:3]


def _in_plane(xp: Any, angle: AnyArray, x_m: float, z_m: float) -> tuple[AnyArray, AnyArray]:
    """A link in its leg's plane, turned about +y."""
    cos, sin = xp.cos(angle), xp.sin(angle)
    return x_m * cos + z_m * sin, z_m * cos - x_m * sin


def _turned(w: AnyArray, u: VectorInBody, v: VectorInBody) -> VectorInBody:
    """Components turned by a quaternion (w, u)."""
    uv = _cross(u, v)
    uuv = _cross(u, uv)
    return (v[0] + 2.0 * (w * uv[0] + uuv[0]), v[1] + 2.0 * (w * uv[1] + uuv[1]), v[2] + 2.0 * (w * uv[2] + uuv[2]))


def _cross(a: VectorInBody, b: VectorInBody) -> VectorInBody:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
