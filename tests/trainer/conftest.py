"""Small configs and a network without training, for the trainer's tests."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from trainer.config.train_config import TrainConfig, config_from_data

TINY: dict[str, Any] = {
    "name": "tiny",
    "iterations": 4,
    "n_envs": 8,
    "save_every": 2,
    "ppo": {"hidden": [16, 8], "steps_per_iteration": 6, "mini_batches": 2, "epochs": 2},
}


@pytest.fixture(autouse=True)
def _one_thread() -> Any:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def tiny() -> TrainConfig:
    return config_from_data(TINY, source="test")
