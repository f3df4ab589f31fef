"""The loop of a training: collect, learn, log; rsl-rl builds networks, storage and connections between processes."""

from __future__ import annotations

import contextlib
import io
import os
import time
from pathlib import Path
from typing import Any

import torch
from rsl_rl.runners import OnPolicyRunner

from spot_model.errors import BadInputError
from spot_model.plant.captured import Captured
from trainer.config.train_config import PpoConfig, TrainConfig, config_yaml
from trainer.ppo.checkpoint import write_checkpoint
from trainer.ppo.ppo import DeviceGaussian, DevicePpo
from trainer.ppo.training_log import StopRequest, TrainingInterruptedError, TrainingLog
from trainer.ppo.vec_env import TaskVecEnv
from trainer.simulate.engine import available_threads


class PpoRunner(OnPolicyRunner):  # type: ignore[misc]  # rsl_rl has no types
    """rsl-rl's runner with our loop, log and checkpoints; only the first of several processes writes."""

    def __init__(self, env: TaskVecEnv, config: TrainConfig, folder: Path, device: str) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(env, rsl_config(config.ppo), log_dir=None, device=device)
        self.config = config
        self.folder = folder
        self.logger = TrainingLog(folder, config, is_writer=self.gpu_global_rank == 0)
        self.stop_request = StopRequest()
        ppo = config.ppo
        self.alg.env = env
        self.alg.mirror_weight = ppo.mirror_loss
        self.alg.mirror_from_iteration = ppo.mirror_from_iteration
        self.alg.settle_iterations = ppo.settle_iterations
        self.alg.critic_first_iterations = ppo.critic_first_iterations
        self.alg.total_iterations = config.iterations
        self.alg.learning_threads = available_threads() if device == "cpu" else 1
        # A normaliser gets a new tensor at each update, and processes exchange gradients; neither is recorded.
        uses_graphs = ppo.cuda_graphs and device != "cpu" and not ppo.normalise_observations
        self.alg.uses_graphs = uses_graphs and not self.is_distributed
        self._collect = Captured(self._collect_steps, env.generators, is_recorded=uses_graphs)

    def run(self, iterations: int, *, is_fresh: bool) -> None:
        """Learn for so many iterations; a fresh run spreads the ends of its first episodes."""
        if is_fresh:
            self.env.spread_episode_ends()
        self.alg.train_mode()
        if self.is_distributed:
            self.alg.broadcast_parameters()
        first = self.current_learning_iteration
        try:
            self.logger.open()
            with self.stop_request.listening():
                for iteration in range(first, first + iterations):
                    self._iterate(iteration)
        finally:
            self.logger.close()

    def collect(self) -> None:
        """Fill the storage with one iteration's steps, returns included; a GPU may still be at it on return."""
        self.env.begin_iteration()
        self._collect()
        self.env.end_iteration()

    def check_finite(self) -> None:
        """Wait for the storage and stop if a number in it is not finite. Raises TrainingDivergedError: one is."""
        self.env.check_finite(self.alg.storage.observations["policy"], self.alg.storage.rewards)

    def close(self) -> None:
        """Wait for the other processes, of which the first writes, and leave them: a live connection aborts an exit."""
        if self.is_distributed:
            torch.distributed.barrier()
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
        steps = self.config.n_envs * self.config.ppo.steps_per_iteration * self.gpu_world_size
        learned = time.perf_counter()
        self.logger.log(
            {
                "iteration": iteration,
                "steps": (iteration + 1) * steps,
                "collect_s": collected - start,
                "learn_s": learned - collected,
                "steps_per_s": steps / (learned - start),
                "learning_rate": float(self.alg.learning_rate),
                "action_std": float(self.alg.get_policy().distribution.std_param.detach().mean()),
                **{f"loss/{key}": value for key, value in losses.items()},
                **self.env.drain_stats(),
                "unix_s": time.time(),
            }
        )
        self.save_if_due(iteration + 1)

    def save_if_due(self, done: int) -> None:
        """Write a checkpoint after ``done`` iterations if it is time, the end, or the user asked to stop.

        Raises:
            TrainingInterruptedError: The user asked to stop; the checkpoint is written.
        """
        total, path = self.config.iterations, self.folder / f"checkpoint_{done:06d}.pt"
        is_due = self.stop_request.is_made or done % self.config.save_every == 0 or done == total
        if is_due and self.gpu_global_rank == 0 and not path.exists():
            content = {
                "config": config_yaml(self.config),
                "iterations_done": done,
                "algorithm": self.alg.save(),
                "environment": self.env.snapshot(),
                "torch_generator": torch.get_rng_state(),
                "cuda_generator": torch.cuda.get_rng_state() if torch.cuda.is_available() else None,
            }
            write_checkpoint(path, content, replace=True)
        if self.stop_request.is_made and done < total:
            raise TrainingInterruptedError(
                f"stopped after iteration {done} of {total}; {path} is saved: go on with "
                f"spot-rl train --resume {self.folder}"
            )

    def load_networks(self, content: dict[str, Any], source: str) -> None:
        """Take over the networks only, the actor's alone where there is no critic, for a run that starts from others.

        Raises:
            BadInputError: The networks have other sizes.
        """
        if self.config.ppo.start_std is not None:
            content["algorithm"]["actor_state_dict"]["distribution.std_param"].fill_(self.config.ppo.start_std)
        has_critic = "critic_state_dict" in content["algorithm"]
        try:
            self.alg.load(content["algorithm"], {"actor": True, "critic": has_critic}, strict=True)
        except RuntimeError as error:
            raise BadInputError(
                f"checkpoint {source}: its networks do not fit the config's ppo.hidden: {error}"
            ) from error

    def restore(self, content: dict[str, Any]) -> None:
        """Go back to the state in which a checkpoint was written.

        Raises:
            BadInputError: The checkpoint holds networks alone, or robots whose state this version's do not have.
        """
        if "environment" not in content:
            raise BadInputError(
                "this checkpoint holds networks alone; start a new run from it with --set start_from=FILE"
            )
        self.alg.load(content["algorithm"], None, strict=True)
        try:
            self.env.restore(content["environment"])
        except (KeyError, ValueError) as error:
            raise BadInputError(
                f"this checkpoint's robots cannot go on: {error}. It is another version's; resume it with the revision "
                "in the run's run.json, or start a new run from its networks with --set start_from=FILE"
            ) from error
        self.current_learning_iteration = int(content["iterations_done"])
        torch.set_rng_state(content["torch_generator"])
        if content["cuda_generator"] is not None and torch.cuda.is_available():
            torch.cuda.set_rng_state(content["cuda_generator"])

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
    return {
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
