"""Some runs of a batch, simulated apart from the others with the same bits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel


@dataclass(frozen=True)
class PartOfBatch:
    """Which runs of a batch are simulated: every ``rows.step``-th."""

    rows: range
    """Their numbers in the batch; ``rows.stop`` is its size."""
    n_ticks: int
    """Policy ticks of the longest run of the batch."""

    @property
    def slice(self) -> slice:
        """Takes the runs out of what the batch has one of for each run."""
        return slice(self.rows.start, None, self.rows.step)

    def draws(self, seed: int) -> np.random.Generator:
        """As ``numpy.random.default_rng(seed)`` for the batch, of whose draws each run gets its own."""
        return _DrawsOfRows(seed, self)

    def model(self, model: RobotModel) -> RobotModel:
        """Of the batch's model, the numbers of these runs."""

        def of_rows(effect: Effect) -> Effect:
            own = {k: v[self.slice] for k, v in effect.values.items() if np.shape(v)[:1] == (self.rows.stop,)}
            return replace(effect, **own)

        return replace(model, effects=tuple(of_rows(effect) for effect in model.effects))


class _DrawsOfRows(np.random.Generator):
    """Draws for every run of a batch, and hands out those of a part."""

    def __init__(self, seed: int, part: PartOfBatch) -> None:
        super().__init__(np.random.PCG64(seed))
        self._part = part

    def __getattribute__(self, name: str) -> Any:
        found = super().__getattribute__(name)
        if name.startswith("_") or not callable(found):
            return found
        if name not in ("standard_normal", "standard_exponential", "random"):
            raise BadInputError(
                f"an effect draws {name}(); allowed with several workers: standard_normal(shape), "
                "standard_exponential(shape), random(shape); draw these, or give --workers 1"
            )
        part = self._part

        def drawn(shape: tuple[int, ...]) -> NDArray[np.float64]:
            whole: NDArray[np.float64] = found((part.rows.stop, *shape[1:]))
            return whole[part.slice]

        return drawn
