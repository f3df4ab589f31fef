"""CMA-ES by ask and tell, with a checkpoint after every generation from which an interrupted search goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from cmaes import CMA

from spot_model.errors import BadInputError
from spot_model.io.whole import write_new, write_over
from spot_model.robot.facts import Array


def read_or_begin(path: Path, head: dict[str, Any]) -> list[dict[str, Any]]:
    """The finished generations of a search; a file that is missing or empty is begun with ``head``.

    Args:
        path: One JSON object a line, the first of them the head.
        head: What the search is of; a file with another head belongs to another search.

    Raises:
        OutputExistsError: Another process began it at the same time.
        BadInputError: The file is damaged, or belongs to another search.
    """
    if not path.exists():
        write_new(path, json.dumps(head) + "\n")
        return []
    lines = path.read_text(encoding="utf-8").split("\n")
    complete, torn = lines[:-1], lines[-1]
    if torn:
        # The process ended while it wrote this line; that generation is searched again.
        write_over(path, "".join(f"{line}\n" for line in complete))
    try:
        entries = [json.loads(line) for line in complete]
    except json.JSONDecodeError as error:
        raise BadInputError(f"checkpoint {path} is damaged: {error}; search in a new folder") from error
    if not entries:
        append_line(path, head)
        return []
    if entries[0] != head:
        what = [key for key in head if entries[0].get(key) != head[key]] if isinstance(entries[0], dict) else ["all"]
        raise BadInputError(
            f"checkpoint {path} belongs to another search ({', '.join(what)} differ); "
            "resume with the same logs and config, or search in a new folder"
        )
    return entries[1:]


def append_line(path: Path, data: dict[str, Any]) -> None:
    """Add one line and wait until it is on the disk."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(data) + "\n")
        file.flush()
        os.fsync(file.fileno())


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
