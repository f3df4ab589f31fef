"""CMA-ES by ask and tell, with a checkpoint after every generation from which an interrupted search goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from trainer.shared.generations_file import append_line, read_or_begin

Array = NDArray[np.float64]
ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class Generation(Generic[ResultT]):
    """One iteration: the points that were asked for, and what they gave."""

    index: int
    points: Array
    """Shape (population, n)."""
    results: tuple[ResultT, ...]


@dataclass(frozen=True)
class Generations(Generic[ResultT]):
    """How a search evaluates, scores and keeps its points.

    Args:
        path: File of finished generations, one JSON object a line; made where it is missing.
        head: What the search is of; a file with another head belongs to another search.
        evaluate: Results of a generation's points, shape (k, n), in their order.
        score: The smaller the better.
        to_data: A result as JSON data.
        from_data: And back.
    """

    path: Path
    head: dict[str, Any]
    evaluate: Callable[[int, Array], Sequence[ResultT]]
    score: Callable[[ResultT], float]
    to_data: Callable[[ResultT], Any]
    from_data: Callable[[Any], ResultT]

    def run(
        self, optimiser: CMA, n: int, on_generation: Callable[[Generation[ResultT]], None] = lambda _: None
    ) -> tuple[Generation[ResultT], ...]:
        """Search for ``n`` generations, or go on where the file ends; the outcome is the same bit for bit.

        Raises:
            BadInputError: The file is damaged or belongs to another search.
        """
        done = read_or_begin(self.path, self.head)
        generations: list[Generation[ResultT]] = []
        for index in range(n):
            points = np.stack([optimiser.ask() for _ in range(optimiser.population_size)])
            if index < len(done):
                results = self._read(done[index], points)
            else:
                results = tuple(self.evaluate(index, points))
                kept = [self.to_data(result) for result in results]
                append_line(self.path, {"generation": index, "points": points.tolist(), "results": kept})
            optimiser.tell(list(zip(points, map(self.score, results), strict=True)))
            generations.append(Generation(index, points, results))
            on_generation(generations[-1])
        return tuple(generations)

    def _read(self, entry: dict[str, Any], points: Array) -> tuple[ResultT, ...]:
        if not np.array_equal(np.array(entry.get("points")), points):
            raise BadInputError(
                f"checkpoint {self.path}: generation {entry.get('generation')} was drawn differently; it was made by "
                "another version of this program, of the optimiser or of NumPy; search in a new folder"
            )
        return tuple(self.from_data(result) for result in entry["results"])
