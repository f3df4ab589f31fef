"""CMA-ES over the gains, in one or several processes, with a checkpoint after every generation."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from cmaes import CMA
from numpy.typing import NDArray

from spot_model.policy.contract import sha256_hex
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.refine.config import RefineConfig
from trainer.refine.gains import gains_of, policy_of, read_layers, with_gains
from trainer.refine.judge import Judgement, judge
from trainer.simulate.engine import IN_THIS_PROCESS, Engine, Place, Tell
from trainer.simulate.generations import Generation, Generations

Array = NDArray[np.float64]

SCHEMA: Final = "spot-rl/refine-search/2"
FRESH: Final = 1_000_000
"""First seed of the starts on which the outcome is compared with the policy it came from; no generation sees them."""


@dataclass(frozen=True)
class Problem:
    """What is searched: a policy's file and what is asked of it."""

    policy: bytes
    config: RefineConfig

    def policy_with(self, values: Array) -> Policy:
        """The candidate with these gains; zeros give the policy itself."""
        contract = policy_from_bytes(self.policy, source="policy").contract
        layers = with_gains(read_layers(self.policy, "policy"), gains_of(contract.joint_names), values)
        return policy_of(layers, contract)[0]

    def judge(self, values: Array, seed: int) -> Judgement:
        """How good the candidate is."""
        return judge(self.policy_with(values), self.config, seed)


def search(
    problem: Problem,
    checkpoint: Path,
    *,
    place: Place = IN_THIS_PROCESS,
    tell: Callable[[Generation[float]], None] = lambda _: None,
) -> Array:
    """Search, or go on where the checkpoint ends; the outcome does not depend on where it was cut, or on ``place``.

    Returns:
        The mean of the last search distribution, in units of the gains' scales.

    Raises:
        BadInputError: The checkpoint is damaged or belongs to another search.
    """
    config = problem.config
    n = len(gains_of(policy_from_bytes(problem.policy, source="policy").contract.joint_names))
    optimiser = CMA(mean=np.zeros(n), sigma=config.sigma, seed=config.seed, population_size=config.population)
    searched = config.model_dump(mode="json", exclude={"generations"})
    with Engine(_judge, problem, place) as engine:
        Generations[float](
            path=checkpoint,
            head={"schema": SCHEMA, "policy": sha256_hex(problem.policy), "search": searched},
            evaluate=lambda index, points: [j.score for j in engine.map([(p, _seed(config, index)) for p in points])],
            score=float,
            to_data=float,
            from_data=float,
        ).run(optimiser, config.generations, tell)
    mean: Array = np.asarray(optimiser.mean, dtype=np.float64)
    return mean


def compare(
    problem: Problem, values: Array, *, place: Place = IN_THIS_PROCESS, seeds: int = 5
) -> tuple[list[Judgement], list[Judgement]]:
    """The policy and the candidate on starts that the search did not see, one judgement a seed."""
    both = [np.zeros_like(values)] * seeds + [values] * seeds
    with Engine(_judge, problem, place) as engine:
        judged = engine.map([(point, FRESH + 10 * (i % seeds)) for i, point in enumerate(both)])
    return judged[:seeds], judged[seeds:]


def _seed(config: RefineConfig, index: int) -> int:
    return config.seed * 10_000 + 10 * index


def _judge(problem: Problem, job: tuple[Array, int], _: Tell) -> Judgement:
    if multiprocessing.parent_process() is not None:
        torch.set_num_threads(1)
    return problem.judge(*job)
