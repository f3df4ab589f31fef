"""CMA-ES over the gains, with several processes and a checkpoint after every generation."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from cmaes import CMA
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.policy.contract import sha256_hex
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.refine.config import RefineConfig
from trainer.refine.gains import gains_of, with_gains
from trainer.refine.judge import Judgement, judge
from trainer.refine.network import policy_of, read_layers
from trainer.shared.generations_file import append_line, read_or_begin

Array = NDArray[np.float64]

SCHEMA: Final = "spot-rl/refine-search/1"
FRESH: Final = 1_000_000
"""First seed of the starts on which the outcome is compared with the policy it came from; no generation sees them."""


@dataclass(frozen=True)
class Generation:
    """One step of the search, as far as somebody who waits wants to know."""

    index: int
    best_score: float
    sigma: float
    seconds_left: float


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
    problem: Problem, checkpoint: Path, *, jobs: int = 1, tell: Callable[[Generation], None] = lambda _: None
) -> Array:
    """Search, or go on where the checkpoint ends; the outcome does not depend on where it was cut, or on ``jobs``.

    Args:
        problem: What is searched.
        checkpoint: File of finished generations.
        jobs: Processes.
        tell: Called after each generation that was run.

    Returns:
        The mean of the last search distribution, in units of the gains' scales.

    Raises:
        BadInputError: The checkpoint is damaged or belongs to another search.
    """
    config = problem.config
    searched = config.model_dump(mode="json", exclude={"generations"})
    done = read_or_begin(checkpoint, {"schema": SCHEMA, "policy": sha256_hex(problem.policy), "search": searched})
    n = len(gains_of(policy_from_bytes(problem.policy, source="policy").contract.joint_names))
    optimiser = CMA(mean=np.zeros(n), sigma=config.sigma, seed=config.seed, population_size=config.population)
    began, ran = time.monotonic(), 0
    with _judges(problem, jobs) as judge_all:
        for index in range(config.generations):
            values = [optimiser.ask() for _ in range(config.population)]
            if index < len(done):
                scores = _scores(done[index], values, checkpoint)
            else:
                scores = [j.score for j in judge_all(values, [_seed(config, index)] * len(values))]
                append_line(checkpoint, {"values": [v.tolist() for v in values], "scores": scores})
                ran += 1
            optimiser.tell(list(zip(values, scores, strict=True)))
            if ran:
                left = (time.monotonic() - began) / ran * (config.generations - index - 1)
                tell(Generation(index, min(scores), float(optimiser._sigma), left))
    mean: Array = np.asarray(optimiser.mean, dtype=np.float64)
    return mean


def compare(
    problem: Problem, values: Array, *, jobs: int = 1, seeds: int = 5
) -> tuple[list[Judgement], list[Judgement]]:
    """The policy and the candidate on starts that the search did not see, one judgement a seed."""
    both = [np.zeros_like(values)] * seeds + [values] * seeds
    with _judges(problem, jobs) as judge_all:
        judged = judge_all(both, [FRESH + 10 * (i % seeds) for i in range(2 * seeds)])
    return judged[:seeds], judged[seeds:]


def _seed(config: RefineConfig, index: int) -> int:
    return config.seed * 10_000 + 10 * index


def _scores(entry: dict[str, Any], values: Sequence[Array], path: Path) -> list[float]:
    if not np.array_equal(np.array(entry["values"]), np.array(values)):
        raise BadInputError(
            f"checkpoint {path}: a generation was drawn differently; it was made by another version of the optimiser "
            "or of NumPy; search in a new folder"
        )
    return [float(s) for s in entry["scores"]]


JudgeAll = Callable[[Sequence[Array], Sequence[int]], list[Judgement]]
"""Judges candidates, each with its seed, in their order."""


@contextmanager
def _judges(problem: Problem, jobs: int) -> Iterator[JudgeAll]:
    if jobs == 1:
        yield lambda values, seeds: [problem.judge(v, s) for v, s in zip(values, seeds, strict=True)]
        return
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _set_problem, (problem,))
    try:
        yield lambda values, seeds: list(pool.map(_judge, values, seeds))
    finally:
        pool.shutdown(cancel_futures=True)


_problem: Problem | None = None


def _set_problem(problem: Problem) -> None:
    global _problem  # noqa: PLW0603 - a worker process keeps its problem for its whole life
    _problem = problem
    torch.set_num_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer


def _judge(values: Array, seed: int) -> Judgement:
    if _problem is None:
        raise RuntimeError("the worker has no problem; it is set when a worker starts")
    return _problem.judge(values, seed)
