"""The paper's search: CMA-ES over the unit cube, with a checkpoint after every generation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from trainer.shared.generations import Generation, Generations
from trainer.simulate.engine import IN_THIS_PROCESS, Engine, Place, Tell
from trainer.sysid.search.config import SearchConfig
from trainer.sysid.search.problem import CandidateResult, Problem

Array = NDArray[np.float64]
Candidates = Engine[Problem, Array, list[CandidateResult]]

SCHEMA: Final = "spot-rl/sysid-search/2"
EDGE: Final = 1e-6
"""The search starts at least so far inside the unit cube, which the optimiser's bounds must contain."""


@dataclass(frozen=True)
class SearchState:
    """All that has been searched."""

    generations: tuple[Generation[CandidateResult], ...]
    mean_unit: Array
    """Mean of the search distribution, shape (n,)."""
    sigma: float
    """Its step size, as a share of the bounds."""

    def units(self) -> Array:
        """All points, shape (n_evaluations, n)."""
        return np.concatenate([g.points for g in self.generations])

    def results(self) -> list[CandidateResult]:
        """All results, in the order of :meth:`units`."""
        return [r for g in self.generations for r in g.results]


def candidates_engine(problem: Problem, place: Place = IN_THIS_PROCESS) -> Candidates:
    """Where candidates of a problem are evaluated."""
    return Engine(_evaluate, problem, place)


def _evaluate(problem: Problem, values: Array, _: Tell) -> list[CandidateResult]:
    return problem.evaluate(values)


def evaluate(engine: Candidates, values: Array) -> list[CandidateResult]:
    """Results of candidates, shape (k, n_parameters), in their order."""
    parts = np.array_split(values, engine.parts(len(values)))
    return [result for part in engine.map(parts) for result in part]


def run_search(
    problem: Problem,
    engine: Candidates,
    config: SearchConfig,
    checkpoint: Path,
    on_generation: Callable[[Generation[CandidateResult]], None] = lambda _: None,
) -> SearchState:
    """Search, or go on where the checkpoint ends; the outcome is the same bit for bit.

    Raises:
        BadInputError: The checkpoint belongs to another search.
    """
    n = problem.space.n
    start = np.clip(problem.space.unit_of_values(problem.space.initial), EDGE, 1.0 - EDGE)
    bounds = np.tile([0.0, 1.0], (n, 1))
    optimiser = CMA(mean=start, sigma=config.sigma, bounds=bounds, seed=config.seed, population_size=config.population)
    search = Generations(
        path=checkpoint,
        head={"schema": SCHEMA, "problem": problem.digest(), "search": config.model_dump(exclude={"generations"})},
        evaluate=lambda _, unit: evaluate(engine, problem.space.values_of_unit(unit)),
        score=problem.score,
        to_data=CandidateResult.to_data,
        from_data=CandidateResult.from_data,
    )
    generations = search.run(optimiser, config.generations, on_generation)
    return SearchState(generations, np.clip(optimiser.mean, 0.0, 1.0), float(optimiser._sigma))
