"""Small configs and a network without training, for the trainer's tests."""

from __future__ import annotations

from typing import Any

import pytest
import torch
import typer

from trainer.config.train_config import TrainConfig, train_config_from_data
from trainer.evaluate.command import evaluate
from trainer.evaluate.export_command import export
from trainer.ppo.train_command import train
from trainer.refine.command import refine

TINY: dict[str, Any] = {
    "name": "tiny",
    "iterations": 4,
    "n_envs": 8,
    "save_every": 2,
    "ppo": {"hidden": [16, 8], "steps_per_iteration": 6, "mini_batches": 2, "epochs": 2},
}


def commands() -> typer.Typer:
    """The trainer's commands, without their way through ``spot-rl``."""
    app = typer.Typer()
    for command in (train, export, evaluate, refine):
        app.command()(command)
    return app


@pytest.fixture(autouse=True)
def _one_thread() -> Any:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def tiny() -> TrainConfig:
    return train_config_from_data(TINY, source="test")
