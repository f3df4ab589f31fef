"""The robots as rsl-rl sees them: parts that move in step, on a CPU side by side in threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from torch import Tensor

from spot_model.errors import SpotRlError
from spot_model.policy.observation import OBSERVATION_LAYOUT
from spot_model.robot import facts
from trainer.task.task import StepResult, Task

T = TypeVar("T")

FEATURES = tuple(name for name, size in OBSERVATION_LAYOUT for _ in range(size))


class TrainingDivergedError(SpotRlError):
    """A number that is not finite came up in training."""


class TaskVecEnv(VecEnv):  # type: ignore[misc]  # rsl_rl has no types
    """The robots of all parts, in order, for rsl-rl.

    On a CPU, one part's physics runs while another's rewards are worked out; one part alone is stepped without a
    thread. Each part draws from its own generator, so results do not depend on which thread is faster. Observations of
    an iteration's end stand at one address, where a graph finds them.
    """

    def __init__(self, parts: Sequence[Task], steps_per_iteration: int) -> None:
        self.parts = tuple(parts)
        self.sizes = [part.n_envs for part in parts]
        self.num_envs = sum(self.sizes)
        self.num_actions = facts.N_JOINTS
        self.max_episode_length = parts[0].max_steps
        self.device = parts[0].device
        self.cfg = parts[0].config.model_dump(mode="json")
        self.steps = 0
        """Policy steps until the end of the last iteration, the same for every environment."""
        self._steps_per_iteration = steps_per_iteration
        # One torch thread each: the parts are what runs side by side.
        threads = min(len(parts), len(os.sched_getaffinity(0)))
        self._pool = ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
        self.begin_iteration()
        self._kept = self._observations = self._groups(_joined([part.start() for part in self.parts]))

    @property
    def iteration(self) -> int:
        """Number of the iteration that the last step belongs to, from 0."""
        return max(0, self.steps - 1) // self._steps_per_iteration

    @property
    def episode_length_buf(self) -> Tensor:
        """Steps of each episode so far, shape (n,), a copy."""
        return torch.cat([part.episode_steps for part in self.parts])

    @property
    def generators(self) -> list[torch.Generator]:
        """What the parts draw from."""
        return [g for part in self.parts for g in (part.generator, *part.backend.generators)]

    def spread_episode_ends(self) -> None:
        """Start each episode at a time of its own, so that not all end at once."""
        steps = torch.randint_like(self.episode_length_buf, high=self.max_episode_length)
        for part, piece in zip(self.parts, torch.split(steps, self.sizes), strict=True):
            part.episode_steps.copy_(piece)

    def get_observations(self) -> TensorDict:
        """The observations last returned."""
        return self._observations

    def begin_iteration(self) -> None:
        """Set what changes from iteration to iteration: command ranges and reward weights."""
        for part in self.parts:
            part.advance_schedule(self.steps // self._steps_per_iteration)

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """One policy period; see :class:`rsl_rl.env.VecEnv`."""
        pieces = torch.split(actions, self.sizes)
        result = _joined(self.side_by_side(lambda i: self.parts[i].step(pieces[i])))
        self._observations = self._groups(result)
        return self._observations, result.reward, result.done, {"time_outs": result.timed_out}

    def side_by_side(self, work: Callable[[int], T]) -> list[T]:
        """``work`` of each part's number, on as many threads as there are cores."""
        if len(self.parts) == 1:
            return [work(0)]
        # Inference mode belongs to a thread; the parts work in the caller's.
        mode = torch.is_inference_mode_enabled()

        def in_mode(i: int) -> T:
            with torch.inference_mode(mode):
                return work(i)

        return list(self._pool.map(in_mode, range(len(self.parts))))

    def keep_observations(self) -> None:
        """Copy the observations to where the next iteration looks for them."""
        self._kept.copy_(self._observations)
        self._observations = self._kept

    def end_iteration(self) -> None:
        """Count the steps of an iteration."""
        self.steps += self._steps_per_iteration

    def drain_stats(self) -> dict[str, float]:
        """Since the last call: share of the command ranges in use and of lost contacts, means over ended episodes.

        Raises:
            PlantDivergedError: Too many contacts found no room.
        """
        drained = [stats for stats in (part.stats.drain() for part in self.parts) if stats]
        total = sum(stats["episodes"] for stats in drained)
        names = drained[0] if drained else {}
        means = {name: sum(s[name] * s["episodes"] for s in drained) / total for name in names}
        lost = max(part.backend.plant.check_room() for part in self.parts)
        share = {"command_share": self.parts[0].commands.share} | ({"contacts_lost": lost} if lost else {})
        return {**share, **means, "episodes": total} if drained else share

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
        task = {str(i): part.snapshot() for i, part in enumerate(self.parts)}
        return {"task": task, "observations": observations, "steps": self.steps}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue exactly from a snapshot of as many robots of the same config."""
        for i, part in enumerate(self.parts):
            part.restore(snapshot["task"][str(i)])
        self.steps = int(snapshot["steps"])
        for key, value in snapshot["observations"].items():
            self._kept[key].copy_(value)
        self._observations = self._kept

    def _groups(self, result: StepResult) -> TensorDict:
        critic = result.observation if self.parts[0].config.critic_sees_noise else result.clean_observation
        groups = {"policy": result.observation, "critic": critic}
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)


def _joined(results: list[StepResult]) -> StepResult:
    if len(results) == 1:
        return results[0]
    return StepResult(*(torch.cat(columns) for columns in zip(*(vars(r).values() for r in results), strict=True)))
