"""Noise on what the policy sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spot_model.policy.observation import OBSERVATION
from trainer.config.task_config import NoiseConfig


def noise_sigmas(config: NoiseConfig) -> NDArray[np.float32]:
    """Standard deviation of each observation feature, shape (48,); commands and the last action have none."""
    values: list[float] = []
    for field in OBSERVATION:
        sigma = getattr(config, field.noise) if field.noise else 0.0
        values += sigma if isinstance(sigma, tuple) else (sigma,) * field.width
    return config.scale * np.array(values, dtype=np.float32)
