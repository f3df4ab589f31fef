"""Per-simulation values of the physics model's fields, for effects and for randomisation."""

from __future__ import annotations

from typing import Any

import mujoco
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_model.plant.model_fields import MujocoFields


class PlantFields(MujocoFields):
    """Fields of the MuJoCo model, shape (n_sims, ...), named as in ``MjModel`` (``opt.<name>`` for options).

    Reading a field gives each simulation its own copy from then on. Call :meth:`commit` after writing, so that what
    MuJoCo derives from a field follows.
    """

    def __init__(self, batch: Batch) -> None:
        super().__init__(batch.model)
        self._batch = batch
        self._names: set[str] = set()

    def __getitem__(self, name: str) -> NDArray[Any]:
        """The live field; writing into it edits the model.

        Raises:
            ValueError: MuJoCo cannot give ``name`` per-simulation values.
        """
        self._names.add(name)
        field: NDArray[Any] = self._batch.expand(name)
        return field

    def commit(self) -> None:
        """Bring derived constants up to date with what was written."""
        derives = set(mujoco.MjModel._setconst_inputs)
        if any(name in derives or name.startswith("opt.") for name in self._names):
            self._batch.set_const()
