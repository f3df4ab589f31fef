"""Noise on what the policy sees."""

from __future__ import annotations

import torch

from spot_model.policy.observation import OBSERVATION
from trainer.config.task_config import NoiseConfig


def noise_sigmas(config: NoiseConfig, device: torch.device | str) -> torch.Tensor:
    """Standard deviation of each observation feature, shape (48,); commands and the last action have none."""
    values: list[float] = []
    for field in OBSERVATION:
        sigma = getattr(config, field.noise) if field.noise else 0.0
        values += sigma if isinstance(sigma, tuple) else (sigma,) * field.width
    return config.scale * torch.tensor(values, device=device, dtype=torch.float32)
