"""The paper's search: CMA-ES by ask and tell over the unit cube, with a checkpoint after every generation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from trainer.shared.generations_file import append_line, read_or_begin
from trainer.sysid.search.config import SearchConfig
from trainer.sysid.search.problem import CandidateResult, Problem
from trainer.sysid.simulation.engine import Engine

Array = NDArray[np.float64]

SCHEMA: Final = "spot-rl/sysid-search/1"
EDGE: Final = 1e-6
"""The search starts at least so far inside the unit cube, which the optimiser's bounds must contain."""


@dataclass(frozen=True)
class Generation:
    """One iteration: the points of the unit cube that were asked for, and what they gave."""

    index: int
    unit: Array
    """Shape (population, n)."""
    results: tuple[CandidateResult, ...]


@dataclass(frozen=True)
class SearchState:
    """All that has been searched."""

    generations: tuple[Generation, ...]
    mean_unit: Array
    """Mean of the search distribution, shape (n,)."""
    sigma: float
    """Its step size, as a share of the bounds."""

    def units(self) -> Array:
        """All points, shape (n_evaluations, n)."""
        return np.concatenate([g.unit for g in self.generations])

    def results(self) -> list[CandidateResult]:
        """All results, in the order of :meth:`units`."""
        return [r for g in self.generations for r in g.results]


def run_search(
    problem: Problem,
    engine: Engine,
    config: SearchConfig,
    checkpoint: Path,
    on_generation: Callable[[Generation], None] = lambda _: None,
) -> SearchState:
    """Search, or go on where the checkpoint ends; the outcome is the same bit for bit.

    Args:
        problem: What is searched.
        engine: Where candidates are evaluated.
        config: Generations, population, step size, seed.
        checkpoint: File of finished generations, one JSON object a line; made where it is missing.
        on_generation: Called after each generation, also for those read from the checkpoint.

    Raises:
        BadInputError: The checkpoint belongs to another search.
    """
    head = {"schema": SCHEMA, "problem": problem.digest(), "search": config.model_dump(exclude={"generations"})}
    done = read_or_begin(checkpoint, head)
    optimiser = _optimiser(problem, config)
    generations: list[Generation] = []
    for index in range(config.generations):
        unit = np.stack([optimiser.ask() for _ in range(config.population)])
        if index < len(done):
            generation = _generation(done[index], unit, checkpoint)
        else:
            generation = Generation(index, unit, tuple(engine.evaluate(problem.space.values_of_unit(unit))))
            append_line(checkpoint, _generation_data(generation))
        scores = [problem.score(r) for r in generation.results]
        optimiser.tell(list(zip(unit, scores, strict=True)))
        generations.append(generation)
        on_generation(generation)
    return SearchState(tuple(generations), np.clip(optimiser.mean, 0.0, 1.0), float(optimiser._sigma))


def _optimiser(problem: Problem, config: SearchConfig) -> Any:
    n = problem.space.n
    start = np.clip(problem.space.unit_of_values(problem.space.initial), EDGE, 1.0 - EDGE)
    bounds = np.tile([0.0, 1.0], (n, 1))
    return CMA(mean=start, sigma=config.sigma, bounds=bounds, seed=config.seed, population_size=config.population)


def _generation(data: dict[str, Any], unit: Array, path: Path) -> Generation:
    if not np.array_equal(np.array(data["unit"]), unit):
        raise BadInputError(
            f"checkpoint {path}: generation {data['generation']} was drawn differently; it was made by another version "
            "of the optimiser or of NumPy; search in a new folder"
        )
    return Generation(data["generation"], unit, tuple(CandidateResult.from_data(r) for r in data["results"]))


def _generation_data(generation: Generation) -> dict[str, Any]:
    return {
        "generation": generation.index,
        "unit": generation.unit.tolist(),
        "results": [r.to_data() for r in generation.results],
    }
