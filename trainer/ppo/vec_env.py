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
    """Adapts tasks; notices numbers that are not finite without waiting for the device at every step."""

    def __init__(self, parts: Sequence[Task], steps_per_iteration: int) -> None:
        self.task = task = TaskParts(parts)
        self.num_envs = task.n_envs
        self.num_actions = facts.N_JOINTS
        self.max_episode_length = task.max_steps
        self.device = task.device
        self.cfg = task.config.model_dump(mode="json")
        self.steps = 0
        """Policy steps since the start of training, the same for every environment."""
        self._steps_per_iteration = steps_per_iteration
        self._bad_step = torch.full((self.num_envs,), -1, dtype=torch.long, device=task.device)
        self._bad_column = torch.zeros(self.num_envs, dtype=torch.long, device=task.device)
        task.advance_schedule(0)
        self._observations = self._groups(task.start())

    @property
    def iteration(self) -> int:
        """Number of the iteration that the last step belongs to, from 0."""
        return max(0, self.steps - 1) // self._steps_per_iteration

    @property
    def episode_length_buf(self) -> Tensor:
        """Steps of each episode so far; rsl-rl writes it to spread the first episodes' ends."""
        return self.task.episode_steps

    @episode_length_buf.setter
    def episode_length_buf(self, steps: Tensor) -> None:
        self.task.set_episode_steps(steps)

    def get_observations(self) -> TensorDict:
        """The observations last returned."""
        return self._observations

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """One policy period; see :class:`rsl_rl.env.VecEnv`."""
        if self.steps % self._steps_per_iteration == 0:
            self.task.advance_schedule(self.steps // self._steps_per_iteration)
        result = self.task.step(actions)
        self.steps += 1
        self._watch(result)
        self._observations = self._groups(result)
        return self._observations, result.reward, result.done, {"time_outs": result.timed_out}

    def check_finite(self) -> None:
        """Stop if a number that is not finite came up since the last call.

        Raises:
            TrainingDivergedError: One did; the message names environment, step and quantity.
        """
        bad = self._bad_step >= 0
        if not bool(bad.any()):
            return
        first = int(torch.where(bad, self._bad_step, self._bad_step.max() + 1).argmin())
        column = int(self._bad_column[first])
        what = FEATURES[column] if column < len(FEATURES) else "the reward"
        raise TrainingDivergedError(
            f"environment {first} of {self.num_envs} gave a number that is not finite in {what} at policy step "
            f"{int(self._bad_step[first])} ({int(bad.sum())} environments did); resume from the last checkpoint with "
            "a lower learning rate, or look at the model's effects"
        )

    def snapshot(self) -> dict[str, Any]:
        """All that an exact continuation needs."""
        observations = {key: value.clone() for key, value in self._observations.items()}
        return {"task": self.task.snapshot(), "observations": observations, "steps": self.steps}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue exactly from a snapshot."""
        self.task.restore(snapshot["task"])
        self.steps = int(snapshot["steps"])
        on_device = {key: value.to(self.device) for key, value in snapshot["observations"].items()}
        self._observations = TensorDict(on_device, batch_size=[self.num_envs], device=self.device)

    def _groups(self, result: StepResult) -> TensorDict:
        critic = result.observation if self.task.config.critic_sees_noise else result.clean_observation
        groups = {"policy": result.observation, "critic": critic}
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)

    def _watch(self, result: StepResult) -> None:
        columns = torch.cat([result.observation, result.reward[:, None]], dim=-1)
        wrong = ~torch.isfinite(columns)
        fresh = wrong.any(dim=-1) & (self._bad_step < 0)
        self._bad_step.masked_fill_(fresh, self.steps)
        self._bad_column.copy_(torch.where(fresh, wrong.long().argmax(dim=-1), self._bad_column))
