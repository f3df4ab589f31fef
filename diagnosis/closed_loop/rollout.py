"""Batches of closed-loop runs as jobs of an engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.closed_loop.part_of_batch import PartOfBatch
from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.read.policy_ticks import Script
from spot_log.read.run import Run
from spot_model.effects.sensing import sensor_noise
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.simulate.engine import IN_THIS_PROCESS, Engine, Place, Tell


@dataclass(frozen=True)
class Rollout:
    """One batch of closed-loop runs of one model; its numbers depend on nothing else."""

    model: RobotModel
    scripts: tuple[Script, ...]
    seed: int
    only_ticks: bool = False
    """No states between the policy's ticks."""
    part: PartOfBatch | None = None
    """Of a larger batch, the runs that these are; None if they are all."""

    def split(self, n_parts: int) -> list[Rollout]:
        """Parts whose runs are those of the whole, bit for bit; part k has every n-th run from run k."""
        if sum(isinstance(effect, sensor_noise.SensorNoise) for effect in self.model.effects) > 1:
            return [self]  # One that vanishes in a part would leave its draws to the other.
        n_ticks = max(len(script.velocity_command) for script in self.scripts)
        parts = [PartOfBatch(range(k, len(self.scripts), n_parts), n_ticks) for k in range(n_parts)]
        return [replace(self, model=p.model(self.model), scripts=self.scripts[p.slice], part=p) for p in parts]


Rollouts = Engine[bytes, Rollout, list[Run]]
"""Computes rollouts under one policy, of which it is given the file's content."""


def rollouts_under(policy: Policy, place: Place = IN_THIS_PROCESS) -> Rollouts:
    """An engine for rollouts under a policy that was loaded from a file.

    Raises:
        BadInputError: The policy has no file.
        EngineError: Ray is asked for and not installed.
    """
    if policy.path is None:
        raise BadInputError(f"policy {policy.contract.name} has no file, and cannot be simulated; load it from a file")
    return Engine(roll_out, policy.path.read_bytes(), place)


def roll_out(policy: bytes, rollout: Rollout, tell: Tell) -> list[Run]:
    """The runs of one rollout.

    Raises:
        BadInputError: The model cannot be simulated.
    """
    part = rollout.part
    noise, of_effects = (np.random.default_rng(s) if part is None else part.draws(s) for s in (rollout.seed, 0))
    return simulate(
        rollout.model,
        policy_from_bytes(policy, source="of the diagnosis"),
        rollout.scripts,
        noise,
        SensorNoise(),
        only_ticks=rollout.only_ticks,
        effects_seed=of_effects,
        least_ticks=0 if part is None else part.n_ticks,
        tell=tell,
    )


def simulate_all(rollouts: Sequence[Rollout], engine: Rollouts, tell: Tell) -> list[list[Run]]:
    """Runs of each rollout, in their order; they are split where the engine has more places than rollouts.

    Raises:
        BadInputError: A model cannot be simulated.
    """
    parts = [r.split(engine.parts(len(r.scripts))) if len(rollouts) < engine.places else [r] for r in rollouts]
    made = iter(engine.map([part for some in parts for part in some], tell))
    runs: list[list[Run]] = []
    for rollout, some in zip(rollouts, parts, strict=True):
        by_part = [next(made) for _ in some]
        runs.append([by_part[i % len(some)][i // len(some)] for i in range(len(rollout.scripts))])
    return runs
