"""Noise on what the policy sees."""

from __future__ import annotations

import torch

from spot_model.policy.observation import OBSERVATION_LAYOUT
from trainer.task.task_config import NoiseConfig


def noise_sigmas(config: NoiseConfig, device: torch.device | str) -> torch.Tensor:
    """Standard deviation of each observation feature, shape (48,); commands and the last action have none."""
    blocks = {
        "linear_vel_of_body_in_body_m_s": config.linear_vel_m_s,
        "angular_vel_of_body_in_body_rad_s": config.angular_vel_rad_s,
        "projected_gravity_in_body": config.gravity,
        "joint_position_offset_rad": (config.joint_position_rad,) * 12,
        "joint_velocity_rad_s": (config.joint_velocity_rad_s,) * 12,
    }
    values = [v for name, size in OBSERVATION_LAYOUT for v in blocks.get(name, (0.0,) * size)]
    return config.scale * torch.tensor(values, device=device, dtype=torch.float32)
