"""Closed-loop runs of models under the logs' policy and commands, as logs, in batches that an engine computes.

Models go side by side as one whose numbers differ from run to run: a batch costs little more than one model. A model
without an effect that another one has gets it with null values, at which it changes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from spot_log.read.run import Run
from spot_model.effects.base import Effect
from spot_model.effects.side_by_side import side_by_side
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.signals.policy_ticks import Script
from trainer.simulate.engine import IN_THIS_PROCESS, Engine, Place, Tell
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

MOST_RUNS: Final = 256
"""Runs of one job on the cores, whatever the number of workers, so that the result is the same at any."""


@dataclass(frozen=True)
class Rollout:
    """One batch of closed-loop runs of one model; its numbers depend on nothing else."""

    model: RobotModel
    scripts: tuple[Script, ...]
    seed: int
    only_ticks: bool = False
    """No states between the policy's ticks."""

    def split(self, most: int) -> list[Rollout]:
        """Batches of at most so many runs, each with a seed of its own; the first has this one's."""
        n = len(self.scripts)
        return [
            replace(self, model=_of_rows(self.model, n, i, i + most), scripts=self.scripts[i : i + most], seed=seed)
            for seed, i in enumerate(range(0, n, most), start=self.seed)
        ]


def _of_rows(model: RobotModel, n: int, start: int, stop: int) -> RobotModel:
    """The model of some runs of a batch of ``n``."""
    if start == 0 and stop >= n:
        return model

    def own(effect: Effect) -> Effect:
        values: dict[str, Any] = {k: v[start:stop] for k, v in effect.values.items() if np.shape(v)[:1] == (n,)}
        return replace(effect, **values)

    return replace(model, effects=tuple(own(effect) for effect in model.effects))


RolloutEngine = Engine[tuple[bytes, str], Rollout, list[Run]]
"""Computes rollouts under one policy, of which it is given the file's content, on a device."""


def rollouts_under(policy: Policy, place: Place = IN_THIS_PROCESS) -> RolloutEngine:
    """An engine for rollouts under a policy that was loaded from a file.

    Raises:
        BadInputError: The policy has no file.
        EngineError: Ray is asked for and not installed.
    """
    if not policy.file_bytes:
        raise BadInputError(f"policy {policy.contract.name} has no file, and cannot be simulated; load it from a file")
    return Engine(runs_of_rollout, (policy.file_bytes, place.device), place)


def runs_of_rollout(shared: tuple[bytes, str], rollout: Rollout, tell: Tell) -> list[Run]:
    """The runs of one rollout. Raises BadInputError: the model cannot be simulated."""
    policy, device = shared
    return simulate_scripts(
        rollout.model,
        policy_from_bytes(policy, source="of the diagnosis"),
        rollout.scripts,
        np.random.default_rng(rollout.seed),
        UsualNoise(),
        only_ticks=rollout.only_ticks,
        device=device,
        tell=tell,
    )


def merged_models(models: Sequence[RobotModel]) -> RobotModel | None:
    """One model for a batch whose run i is of ``models[i]``; None where no such model exists.

    Models have plain numbers, or one number a joint, shape (1, J).
    """
    first = models[0]
    if all(m is first for m in models):
        return first
    wide = [np.shape(v) for m in models for e in m.effects for v in e.values.values() if np.ndim(v)]
    if any(m.robot != first.robot for m in models) or any(shape[0] != 1 for shape in wide):
        return None
    apart = list({id(m): m for m in models}.values())
    which = np.array([next(i for i, other in enumerate(apart) if other is m) for m in models])
    return RobotModel(side_by_side([m.effects for m in apart], which))


def run_all(
    jobs: Sequence[tuple[RobotModel, Script]],
    engine: RolloutEngine,
    rng: np.random.Generator,
    tell: Tell,
    *,
    only_ticks: bool = False,
) -> list[Run]:
    """A run of each model and script, in their order: in one batch where the models allow it, else in one for each.

    Raises:
        BadInputError: A model cannot be simulated.
    """
    if not jobs:
        return []
    together = merged_models([model for model, _ in jobs])
    by_model: dict[int, list[int]] = {}
    for i, (model, _) in enumerate(jobs):
        by_model.setdefault(id(together or model), []).append(i)
    rollouts = [
        Rollout(
            together or jobs[rows[0]][0],
            tuple(jobs[i][1] for i in rows),
            int(rng.integers(2**31)),
            only_ticks=only_ticks,
        )
        for rows in by_model.values()
    ]
    made: dict[int, Run] = {}
    for rows, runs in zip(by_model.values(), simulate_all(rollouts, engine, tell), strict=True):
        made.update(zip(rows, runs, strict=True))
    return [made[i] for i in range(len(jobs))]


def simulate_all(rollouts: Sequence[Rollout], engine: RolloutEngine, tell: Tell) -> list[list[Run]]:
    """Runs of each rollout, in their order; on the cores as jobs of at most :data:`MOST_RUNS` runs.

    Raises:
        BadInputError: A model cannot be simulated.
    """
    parts = [r.split(MOST_RUNS if engine.place.device == "cpu" else len(r.scripts)) for r in rollouts]
    made = iter(engine.map([part for some in parts for part in some], tell))
    return [[run for _ in some for run in next(made)] for some in parts]
