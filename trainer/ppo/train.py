"""A training run from beginning to end."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
from typing import Final

import torch

from spot_model.errors import BadInputError
from spot_model.policy.built_in import policy_or_run
from trainer.config.train_config import TrainConfig
from trainer.ppo.checkpoint import check_run_folder, config_of, find_checkpoint, make_run_folder, read_checkpoint
from trainer.ppo.checkpoint_policy import networks_of_policy
from trainer.ppo.runner import PpoRunner
from trainer.ppo.vec_env import TaskVecEnv
from trainer.simulate.engine import check_device
from trainer.task.task import make_tasks


def train_policy(config: TrainConfig, folder: Path, *, device: str, command: str = "") -> Path:
    """Train from nothing (or from ``config.start_from``'s networks) into an empty folder; returns the last checkpoint.

    Raises:
        BadInputError: The device is not there, the folder is not empty, or the config names what does not exist.
    """
    device = local_device(device)
    check_device(device)
    source = find_checkpoint(policy_or_run(config.start_from)) if config.start_from else None
    networks = None
    if source is not None and source.suffix == ".onnx":
        networks, hidden = networks_of_policy(source)
        config = config.model_copy(update={"ppo": config.ppo.model_copy(update={"hidden": hidden})})
    elif source is not None:
        networks = read_checkpoint(source)
    if is_first_process():
        check_run_folder(folder)
    env = make_robots(config, device)
    if is_first_process():
        make_run_folder(folder, config, command, device)
    runner = PpoRunner(env, config, folder, device)
    if networks is not None:
        runner.load_networks(networks, str(source))
    runner.run(config.iterations, is_fresh=True)
    runner.close()
    return find_checkpoint(folder)


def resume(run: Path, *, device: str, iterations: int | None = None) -> Path:
    """Continue a run exactly where its newest checkpoint stands, up to ``iterations`` in all.

    Raises:
        BadInputError: There is no checkpoint, or the run is finished.
    """
    device = local_device(device)
    check_device(device)
    path = find_checkpoint(run)
    content = read_checkpoint(path)
    config = config_of(content, str(path))
    if iterations is not None:
        config = config.model_copy(update={"iterations": iterations})
    left = config.iterations - int(content["iterations_done"])
    if left <= 0:
        raise BadInputError(
            f"run {run} has done {content['iterations_done']} of {config.iterations} iterations; "
            "give more with --set iterations=N"
        )
    runner = make_runner(config, path.parent, device)
    runner.restore(content)
    runner.run(left, is_fresh=False)
    runner.close()
    return find_checkpoint(path.parent)


def make_runner(config: TrainConfig, folder: Path, device: str) -> PpoRunner:
    """Task, log and PPO for a config, seeded."""
    return PpoRunner(make_robots(config, device), config, folder, device)


def make_robots(config: TrainConfig, device: str) -> TaskVecEnv:
    """The robots of a config; seeds torch, too."""
    rank = int(os.getenv("RANK", "0"))
    torch.manual_seed(config.seed * 1000 + rank)
    if device == "cpu":
        torch.set_num_threads(1)
        keep_freed_memory()
    else:
        torch.set_float32_matmul_precision("high")
    return TaskVecEnv(make_tasks(config, device, rank=rank), config.ppo.steps_per_iteration)


def is_first_process() -> bool:
    """Whether this is the only process, or the first that torchrun started."""
    return int(os.getenv("RANK", "0")) == 0


def local_device(device: str) -> str:
    """The device of this process: with torchrun, each has its own GPU."""
    return f"cuda:{os.getenv('LOCAL_RANK', '0')}" if device == "cuda" else device


_TRIM_THRESHOLD: Final = -1
_MMAP_MAX: Final = -4
"""Parameters of glibc's mallopt(3)."""


def keep_freed_memory() -> None:
    """Let the C library keep what is freed, for the next time.

    By default glibc hands arrays above 32 MB back to the kernel at once. Learning on a CPU makes such arrays at every
    layer of every mini-batch, and each came back as 12,000 page faults. Where the C library has
    no such setting, nothing changes.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_MAX, 0)
        mallopt(_TRIM_THRESHOLD, 2**31 - 1)
