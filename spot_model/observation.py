"""The 48 numbers that the policy sees, built in one place for training, deployment and identification."""

from __future__ import annotations

from typing import Final

from spot_model.arrays import namespace_of
from spot_model.rotation import AnyArray, matrix_from_wxyz

OBSERVATION_LAYOUT: Final = (
    ("linear_vel_of_body_in_body_m_s", 3),
    ("angular_vel_of_body_in_body_rad_s", 3),
    ("projected_gravity_in_body", 3),
    ("velocity_command", 3),
    ("joint_position_offset_rad", 12),
    ("joint_velocity_rad_s", 12),
    ("last_action", 12),
)
"""Blocks of the observation in order, with their sizes. Source: the paper's observation equation."""

N_OBSERVATION: Final = sum(size for _, size in OBSERVATION_LAYOUT)


def build_observation(
    *,
    world_from_body_wxyz: AnyArray,
    linear_vel_of_body_in_world_m_s: AnyArray,
    angular_vel_of_body_in_world_rad_s: AnyArray,
    velocity_command: AnyArray,
    position_rad: AnyArray,
    velocity_rad_s: AnyArray,
    last_action: AnyArray,
    default_position_rad: AnyArray,
) -> AnyArray:
    """Assemble the policy's observation; a joint-order change is the caller's, and the same for every joint block.

    Args:
        world_from_body_wxyz: Attitude (odom counts as world). Shape (..., 4).
        linear_vel_of_body_in_world_m_s: Shape (..., 3).
        angular_vel_of_body_in_world_rad_s: Shape (..., 3).
        velocity_command: Operator's V_x, V_y (m/s) and ω_z (rad/s) in the body frame. Shape (..., 3).
        position_rad: Joint position. Shape (..., 12), rad.
        velocity_rad_s: Joint velocity. Shape (..., 12), rad/s.
        last_action: The network's previous output. Shape (..., 12), unscaled.
        default_position_rad: Broadcastable to (..., 12), rad, same joint order.

    Returns:
        Observation, shape (..., 48), in the order of :data:`OBSERVATION_LAYOUT`.
    """
    xp = namespace_of(position_rad)
    # One matrix serves all three vectors; this runs in the control loop, where quaternion products cost too much.
    world_from_body = matrix_from_wxyz(world_from_body_wxyz)
    return xp.concat(
        [
            xp.sum(world_from_body * linear_vel_of_body_in_world_m_s[..., :, None], axis=-2),
            xp.sum(world_from_body * angular_vel_of_body_in_world_rad_s[..., :, None], axis=-2),
            -world_from_body[..., 2, :],
            velocity_command,
            position_rad - default_position_rad,
            velocity_rad_s,
            last_action,
        ],
        axis=-1,
    )
