"""Foot motion in the world for the rewards, by spot_model's leg kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.rotation import rotate_wxyz
from trainer.backends.backend import PlantState

Tensor = torch.Tensor


@dataclass(frozen=True)
class FootMotion:
    """The four feet (centres of their spheres), legs fl, fr, hl, hr."""

    position_in_world_m: Tensor
    """Shape (n, 4, 3)."""
    velocity_in_world_m_s: Tensor
    """Shape (n, 4, 3)."""


def foot_motion(state: PlantState) -> FootMotion:
    """Where the feet are and how they move, from joints and body alone."""
    position, jacobian = foot_position_and_jacobian(state.position_rad)
    rates = state.velocity_rad_s.reshape(-1, 4, 1, 3)
    attitude = state.world_from_body_wxyz[:, None, :].expand(-1, 4, -1)
    arm = rotate_wxyz(attitude, position)
    relative = rotate_wxyz(attitude, (jacobian * rates).sum(dim=-1))
    spin = state.angular_vel_of_body_in_world_rad_s[:, None, :].expand_as(arm)
    return FootMotion(
        position_in_world_m=state.body_position_m[:, None, :] + arm,
        velocity_in_world_m_s=(
            state.linear_vel_of_body_in_world_m_s[:, None, :] + torch.linalg.cross(spin, arm) + relative
        ),
    )
