"""The loop of a training: collect, learn, log; rsl-rl builds networks, storage and connections between processes."""

from __future__ import annotations

import contextlib
import copy
import io
import os
import time
from typing import Any

import torch
from rsl_rl.runners import OnPolicyRunner

from spot_model.plant.gpu.captured import Captured
from trainer.config.train_config import PpoConfig, TrainConfig
from trainer.ppo.ppo import DeviceGaussian, DevicePpo
from trainer.ppo.training_log import TrainingLog
from trainer.ppo.vec_env import TaskVecEnv
from trainer.simulate.engine import available_threads


class PpoRunner(OnPolicyRunner):  # type: ignore[misc]  # rsl_rl has no types
    """rsl-rl's runner with our loop and log; checkpoints are :mod:`trainer.ppo.checkpoint`'s."""

    def __init__(self, env: TaskVecEnv, config: TrainConfig, log: TrainingLog, device: str) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(env, rsl_config(config.ppo), log_dir=None, device=device)
        self.config = config
        self.logger = log
        ppo = config.ppo
        self.alg.env = env
        self.alg.mirror_weight = ppo.mirror_loss
        self.alg.mirror_from_iteration = ppo.mirror_from_iteration
        self.alg.settle_iterations = ppo.settle_iterations
        self.alg.total_iterations = config.iterations
        self.alg.learning_threads = available_threads() if device == "cpu" else 1
        # A normaliser gets a new tensor at each update, and processes exchange gradients; neither is recorded.
        uses_graphs = ppo.cuda_graphs and device != "cpu" and not ppo.normalise_observations
        self.alg.uses_graphs = uses_graphs and not self.is_distributed
        self._collect = Captured(self._collect_steps, env.task.generators, is_recorded=uses_graphs)

    def run(self, iterations: int, *, is_fresh: bool) -> None:
        """Learn for so many iterations; a fresh run spreads the ends of its first episodes."""
        if is_fresh:
            self.env.spread_episode_ends()
        self.alg.train_mode()
        if self.is_distributed:
            self.alg.broadcast_parameters()
        first = self.current_learning_iteration
        try:
            self.logger.init_logging_writer()
            with self.logger.stop_request.listening():
                for iteration in range(first, first + iterations):
                    self._iterate(iteration)
        finally:
            self.logger.stop_logging_writer()

    def collect(self) -> None:
        """Fill the storage with one iteration's steps, returns included; a GPU may still be at it on return."""
        self.env.begin_iteration()
        self._collect()
        self.env.end_iteration()

    def check_finite(self) -> None:
        """Wait for the storage and stop if a number in it is not finite.

        Raises:
            TrainingDivergedError: One is.
        """
        self.env.check_finite(self.alg.storage.observations["policy"], self.alg.storage.rewards)

    def close(self) -> None:
        """Leave the other processes, if there are any: a connection alive at the interpreter's end aborts it."""
        if self.is_distributed:
            torch.distributed.destroy_process_group()

    def _iterate(self, iteration: int) -> None:
        start = time.perf_counter()
        self.collect()
        # While a GPU collects, the host writes down the iteration before.
        self.logger.write()
        self.check_finite()
        collected = time.perf_counter()
        losses = self.alg.update()
        self.current_learning_iteration = iteration
        self.logger.log(
            iteration,
            collect_time=collected - start,
            learn_time=time.perf_counter() - collected,
            loss_dict=losses,
            learning_rate=float(self.alg.learning_rate),
            action_std=float(self.alg.get_policy().distribution.std_param.detach().mean()),
        )
        self.logger.checkpoint(self, iteration)

    def _collect_steps(self) -> None:
        with torch.inference_mode():
            observations = self.env.get_observations()
            for _ in range(self.cfg["num_steps_per_env"]):
                actions = self.alg.act(observations)
                observations, rewards, dones, extras = self.env.step(actions)
                self.alg.process_env_step(observations, rewards, dones, extras)
            self.alg.compute_returns(observations)
            self.env.keep_observations()

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


def rsl_config(ppo: PpoConfig) -> dict[str, Any]:
    """rsl-rl's config dictionary; a fresh one each time, because rsl-rl writes into it."""
    network: dict[str, Any] = {"class_name": "MLPModel", "hidden_dims": list(ppo.hidden), "activation": "elu"}
    network["obs_normalization"] = ppo.normalise_observations
    gaussian = {"class_name": DeviceGaussian, "init_std": ppo.initial_std, "std_type": "scalar"}
    config = {
        "num_steps_per_env": ppo.steps_per_iteration,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**network, "distribution_cfg": gaussian},
        "critic": network,
        "algorithm": {
            "class_name": DevicePpo,
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
            "symmetry_cfg": None,
        },
    }
    return copy.deepcopy(config)
