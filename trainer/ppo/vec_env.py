"""The task as rsl-rl sees it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from spot_model.errors import SpotRlError
from spot_model.policy.observation import OBSERVATION_LAYOUT
from spot_model.robot import facts
from trainer.task.task import StepResult, Task
from trainer.task.task_parts import TaskParts

Tensor = torch.Tensor

FEATURES = tuple(name for name, size in OBSERVATION_LAYOUT for _ in range(size))


class TrainingDivergedError(SpotRlError):
    """A number that is not finite came up in training."""


class TaskVecEnv(VecEnv):  # type: ignore[misc]  # rsl_rl has no types
    """Adapts tasks to rsl-rl. Observations of an iteration's end stand at one address, where a graph finds them."""

    def __init__(self, parts: Sequence[Task], steps_per_iteration: int) -> None:
        self.task = task = TaskParts(parts)
        self.num_envs = task.n_envs
        self.num_actions = facts.N_JOINTS
        self.max_episode_length = task.max_steps
        self.device = task.device
        self.cfg = task.config.model_dump(mode="json")
        self.steps = 0
        """Policy steps until the end of the last iteration, the same for every environment."""
        self._steps_per_iteration = steps_per_iteration
        task.advance_schedule(0)
        self._kept = self._observations = self._groups(task.start())

    @property
    def iteration(self) -> int:
        """Number of the iteration that the last step belongs to, from 0."""
        return max(0, self.steps - 1) // self._steps_per_iteration

    @property
    def episode_length_buf(self) -> Tensor:
        """Steps of each episode so far, shape (n,)."""
        return self.task.episode_steps

    def spread_episode_ends(self) -> None:
        """Start each episode at a time of its own, so that not all end at once."""
        self.task.set_episode_steps(torch.randint_like(self.episode_length_buf, high=self.max_episode_length))

    def get_observations(self) -> TensorDict:
        """The observations last returned."""
        return self._observations

    def begin_iteration(self) -> None:
        """Set what changes from iteration to iteration: command ranges and reward weights."""
        self.task.advance_schedule(self.steps // self._steps_per_iteration)

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """One policy period; see :class:`rsl_rl.env.VecEnv`."""
        result = self.task.step(actions)
        self._observations = self._groups(result)
        return self._observations, result.reward, result.done, {"time_outs": result.timed_out}

    def keep_observations(self) -> None:
        """Copy the observations to where the next iteration looks for them."""
        self._kept.copy_(self._observations)
        self._observations = self._kept

    def end_iteration(self) -> None:
        """Count the steps of an iteration."""
        self.steps += self._steps_per_iteration

    def check_finite(self, observations: Tensor, rewards: Tensor) -> None:
        """Stop if an iteration, or the observations at its end, hold a number that is not finite.

        Args:
            observations: What the policy saw before each step, shape (steps, n, 48).
            rewards: Of each step, shape (steps, n, 1).

        Raises:
            TrainingDivergedError: One does; the message names environment, step and quantity.
        """
        last = self._observations["policy"][None]
        # A sum is finite only if every number is.
        if bool(torch.isfinite(observations.sum() + last.sum() + rewards.sum())):
            return
        # A step gives a reward, and the observations before the next step.
        rows = torch.cat([torch.cat([observations, last])[1:], rewards], dim=-1)
        first = torch.cat([observations[:1], torch.zeros_like(rewards[:1])], dim=-1)
        wrong = ~torch.isfinite(torch.cat([first, rows]))
        where = wrong.nonzero()
        if len(where) == 0:
            return
        step, environment, column = where[0].tolist()
        what = FEATURES[column] if column < len(FEATURES) else "the reward"
        raise TrainingDivergedError(
            f"environment {environment} of {self.num_envs} gave a number that is not finite in {what} at policy step "
            f"{self.steps - len(rewards) + step} ({int(wrong.any(-1).any(0).sum())} environments did); resume from the "
            "last checkpoint with a lower learning rate, or look at the model's effects"
        )

    def snapshot(self) -> dict[str, Any]:
        """All that an exact continuation needs."""
        observations = {key: value.clone() for key, value in self._observations.items()}
        return {"task": self.task.snapshot(), "observations": observations, "steps": self.steps}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue exactly from a snapshot."""
        self.task.restore(snapshot["task"])
        self.steps = int(snapshot["steps"])
        for key, value in snapshot["observations"].items():
            self._kept[key].copy_(value)
        self._observations = self._kept

    def _groups(self, result: StepResult) -> TensorDict:
        critic = result.observation if self.task.config.critic_sees_noise else result.clean_observation
        groups = {"policy": result.observation, "critic": critic}
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)
