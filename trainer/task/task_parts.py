"""Several tasks that move in step as one: on a CPU, one part's physics runs while another's rewards are worked out."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import torch

from trainer.task.task import StepResult, Task

Tensor = torch.Tensor
T = TypeVar("T")


class TaskParts:
    """The robots of all parts, in order; one part alone is stepped without a thread.

    Each part draws from its own generator, so results do not depend on which thread is faster.
    """

    def __init__(self, parts: Sequence[Task]) -> None:
        self.parts = tuple(parts)
        self.config, self.device, self.max_steps = parts[0].config, parts[0].device, parts[0].max_steps
        self.sizes = [part.n_envs for part in parts]
        self.n_envs = sum(self.sizes)
        threads = min(len(parts), len(os.sched_getaffinity(0)))
        # One torch thread each: the parts are what runs side by side.
        self._pool = ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))

    def start(self) -> StepResult:
        """Reset every robot and observe."""
        return _joined([part.start() for part in self.parts])

    def step(self, action: Tensor) -> StepResult:
        """One policy period; actions of shape (n, 12)."""
        pieces = torch.split(action, self.sizes)
        return _joined(self.side_by_side(lambda i: self.parts[i].step(pieces[i])))

    @property
    def episode_steps(self) -> Tensor:
        """Steps of each episode so far, shape (n,), a copy."""
        return torch.cat([part.episode_steps for part in self.parts])

    def set_episode_steps(self, steps: Tensor) -> None:
        """Write them, shape (n,)."""
        for part, piece in zip(self.parts, torch.split(steps, self.sizes), strict=True):
            part.episode_steps.copy_(piece)

    @property
    def generators(self) -> list[torch.Generator]:
        """What the parts draw from."""
        return [g for part in self.parts for g in (part.generator, *part.backend.generators)]

    def advance_schedule(self, iteration: int) -> None:
        """Set the command ranges and the reward weights that this iteration uses."""
        for part in self.parts:
            part.advance_schedule(iteration)

    @property
    def command_share(self) -> float:
        """Share of the command ranges in use."""
        return self.parts[0].commands.share

    def drain_stats(self) -> dict[str, float]:
        """Means over all episodes that ended since the last call; empty if none ended."""
        drained = [stats for stats in (part.stats.drain() for part in self.parts) if stats]
        total = sum(stats["episodes"] for stats in drained)
        names = drained[0] if drained else {}
        means = {name: sum(s[name] * s["episodes"] for s in drained) / total for name in names}
        return {**means, "episodes": total} if drained else {}

    def snapshot(self) -> dict[str, Any]:
        """All that :meth:`restore` needs to continue exactly, apart from the observation last returned."""
        return {str(i): part.snapshot() for i, part in enumerate(self.parts)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of as many robots of the same config."""
        for i, part in enumerate(self.parts):
            part.restore(snapshot[str(i)])

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


def _joined(results: list[StepResult]) -> StepResult:
    if len(results) == 1:
        return results[0]
    return StepResult(*(torch.cat(columns) for columns in zip(*(vars(r).values() for r in results), strict=True)))
