"""From a config to a running task, on a CPU or a GPU."""

from __future__ import annotations

import itertools
import math
import os
from typing import Final

import torch

from trainer.backends.plant_backend import PlantBackend
from trainer.backends.random_draws import Draws
from trainer.config.train_config import TrainConfig
from trainer.simulate.device import check_device
from trainer.task.initial_state import draw_simulations
from trainer.task.randomised_effects import training_effects
from trainer.task.task import Task

PART_SIZE: Final = 512
"""Robots of one part on a CPU: enough that its arithmetic outweighs Python, and two parts of the usual 1,024. From
four parts on they are twice as large: 4 % faster."""
MOST_PARTS: Final = 10_000


def make_tasks(config: TrainConfig, device: str, *, rank: int = 0) -> list[Task]:
    """The robots of a config: one task on a GPU, parts of some :data:`PART_SIZE` robots on a CPU.

    The parts depend on the config alone, not on the machine, so a run can be repeated on another.

    Raises:
        BadInputError: The device does not exist, or the model or an effect is not allowed.
    """
    size = PART_SIZE if config.n_envs < 4 * PART_SIZE else 2 * PART_SIZE
    n_parts = math.ceil(config.n_envs / size) if device == "cpu" else 1
    threads = max(1, len(os.sched_getaffinity(0)) // n_parts)
    ends = [round(config.n_envs * i / n_parts) for i in range(n_parts + 1)]
    return [
        make_task(
            config.model_copy(update={"n_envs": end - start}),
            device,
            seed=(config.seed * 1000 + rank) * MOST_PARTS + part,
            n_threads=threads,
        )
        for part, (start, end) in enumerate(itertools.pairwise(ends))
    ]


def make_task(config: TrainConfig, device: str, *, seed: int, n_threads: int = 0) -> Task:
    """Build one back end and its task.

    Args:
        config: What to train.
        device: "cpu", or a CUDA device such as "cuda:0".
        seed: Of all draws.
        n_threads: CPU threads for physics, 0 for all.

    Raises:
        BadInputError: The device does not exist, or the model or an effect is not allowed.
    """
    check_device(device)
    generator = torch.Generator(device=device)
    generator.manual_seed(seed)
    draws = Draws(generator)
    randomisation = config.task.randomisation
    effects = training_effects(config.model, randomisation, config.n_envs, draws)
    simulations = draw_simulations(randomisation, config.n_envs, draws)
    backend = PlantBackend(config.task, effects, simulations, device, n_threads, seed=seed)
    return Task(config.task, backend, generator)
