"""An adapter of rsl-rl's PPO: takes a copy of our config and hides rsl-rl's peculiarities."""

from __future__ import annotations

import contextlib
import copy
import io
import os
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.runners import OnPolicyRunner

from trainer.config.train_config import PpoConfig, TrainConfig
from trainer.ppo.symmetry import with_mirror_images
from trainer.ppo.training_log import TrainingLog
from trainer.ppo.vec_env import TaskVecEnv
from trainer.shared.threads import available_threads

SETTLED_KL_SHARE = 0.2
"""Of the KL target, at the end of the settling iterations."""


class CheckedPpo(PPO):  # type: ignore[misc]  # rsl_rl has no types
    """PPO that looks for numbers that are not finite before it learns, and uses all cores only to learn."""

    env: TaskVecEnv
    learning_threads: int = 1
    mirror_from_iteration: int = 0
    settle_iterations: int = 0
    total_iterations: int = 0
    entropy_coef: float
    desired_kl: float
    symmetry: Any

    def act(self, obs: Any) -> torch.Tensor:
        """Sample actions with as many torch threads as learning has: nothing else runs meanwhile."""
        before = torch.get_num_threads()
        torch.set_num_threads(self.learning_threads)
        try:
            actions: torch.Tensor = super().act(obs)
        finally:
            torch.set_num_threads(before)
        return actions

    def compute_returns(self, obs: Any) -> None:
        """Check the rollout, then compute returns and advantages."""
        self.env.check_finite()
        super().compute_returns(obs)

    def update(self) -> dict[str, float]:
        """Learn, with :attr:`learning_threads` torch threads; while robots move there is one."""
        before, symmetry, released = torch.get_num_threads(), self.symmetry, (self.entropy_coef, self.desired_kl)
        self.entropy_coef, self.desired_kl = self._settled(*released)
        torch.set_num_threads(self.learning_threads)
        if self.env.iteration < self.mirror_from_iteration:
            self.symmetry = None
        try:
            losses: dict[str, float] = super().update()
        finally:
            torch.set_num_threads(before)
            self.symmetry = symmetry
            self.entropy_coef, self.desired_kl = released
        return losses

    def _settled(self, entropy: float, desired_kl: float) -> tuple[float, float]:
        """Entropy weight and KL target of this iteration."""
        left = self.total_iterations - self.env.iteration
        if self.settle_iterations == 0 or left >= self.settle_iterations:
            return entropy, desired_kl
        share = max(0.0, left / self.settle_iterations)
        return entropy * share, desired_kl * (SETTLED_KL_SHARE + (1.0 - SETTLED_KL_SHARE) * share)


class PpoRunner(OnPolicyRunner):  # type: ignore[misc]  # rsl_rl has no types
    """rsl-rl's loop with our log; checkpoints are :mod:`trainer.ppo.checkpoint`'s."""

    def __init__(self, env: TaskVecEnv, config: TrainConfig, log: TrainingLog, device: str) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(env, rsl_config(config.ppo), log_dir=None, device=device)
        self.config = config
        self.logger = log
        self.alg.env = env
        self.alg.mirror_from_iteration = config.ppo.mirror_from_iteration
        self.alg.settle_iterations = config.ppo.settle_iterations
        self.alg.total_iterations = config.iterations
        self.alg.learning_threads = available_threads() if device == "cpu" else 1

    def run(self, iterations: int, *, is_fresh: bool) -> None:
        """Learn for so many iterations; a fresh run spreads the ends of its first episodes."""
        quietly = contextlib.redirect_stdout(io.StringIO()) if self.is_distributed else contextlib.nullcontext()
        try:
            with quietly, self.logger.stop_request.listening():
                self.learn(iterations, init_at_random_ep_len=is_fresh)
        finally:
            self.logger.stop_logging_writer()

    def save(self, path: str, infos: dict[str, Any] | None = None) -> None:
        """Write a checkpoint through the log, which knows the run's folder; rsl-rl's own path is not used."""
        self.logger.checkpoint(self, self.current_learning_iteration)

    def _configure_multi_gpu(self) -> None:
        """rsl-rl's way for several GPUs; on CPUs the same with gloo, so that the path can be tested."""
        if int(os.getenv("WORLD_SIZE", "1")) == 1 or self.device != "cpu":
            super()._configure_multi_gpu()
            return
        self.gpu_world_size = int(os.environ["WORLD_SIZE"])
        self.gpu_local_rank = int(os.environ["LOCAL_RANK"])
        self.gpu_global_rank = int(os.environ["RANK"])
        self.is_distributed = True
        self.cfg["multi_gpu"] = {
            "global_rank": self.gpu_global_rank,
            "local_rank": self.gpu_local_rank,
            "world_size": self.gpu_world_size,
        }
        torch.distributed.init_process_group(backend="gloo", rank=self.gpu_global_rank, world_size=self.gpu_world_size)

    def close(self) -> None:
        """Leave the other processes, if there are any: a connection alive at the interpreter's end aborts it."""
        if self.is_distributed:
            torch.distributed.destroy_process_group()


def rsl_config(ppo: PpoConfig) -> dict[str, Any]:
    """rsl-rl's config dictionary; a fresh one each time, because rsl-rl writes into it."""
    network: dict[str, Any] = {"class_name": "MLPModel", "hidden_dims": list(ppo.hidden), "activation": "elu"}
    network["obs_normalization"] = ppo.normalise_observations
    gaussian = {"class_name": "GaussianDistribution", "init_std": ppo.initial_std, "std_type": "scalar"}
    symmetry = {
        "data_augmentation_func": with_mirror_images,
        "use_data_augmentation": False,
        "use_mirror_loss": True,
        "mirror_loss_coeff": ppo.mirror_loss,
    }
    config = {
        "num_steps_per_env": ppo.steps_per_iteration,
        # The log decides when to save: it is asked after every iteration.
        "save_interval": 1,
        "check_for_nan": False,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**network, "distribution_cfg": gaussian},
        "critic": network,
        "algorithm": {
            "class_name": CheckedPpo,
            "num_learning_epochs": ppo.epochs,
            "num_mini_batches": ppo.mini_batches,
            "clip_param": ppo.clip,
            "gamma": ppo.gamma,
            "lam": ppo.lam,
            "value_loss_coef": ppo.value_loss,
            "use_clipped_value_loss": ppo.clip_value_loss,
            "entropy_coef": ppo.entropy,
            "learning_rate": ppo.learning_rate,
            "max_grad_norm": ppo.max_grad_norm,
            "schedule": ppo.schedule,
            "desired_kl": ppo.desired_kl,
            "use_mixed_precision": ppo.mixed_precision,
            "symmetry_cfg": symmetry if ppo.mirror_loss > 0.0 else None,
        },
    }
    return copy.deepcopy(config)
