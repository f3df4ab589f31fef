"""The fields of MuJoCo models, of one or a value each simulation, as effects and randomisation read and write them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_model.effects.base import Effect, ModelEffect
from spot_model.robot import facts

FIRST_JOINT_DOF = 6
"""The free base has six degrees of freedom, and seven coordinates."""
FIRST_JOINT_COORDINATE = 7


class MujocoFields:
    """Fields of a model, named as in ``MjModel`` (``opt.<name>`` for options), with a leading axis of length 1."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model

    def __getitem__(self, name: str) -> NDArray[Any]:
        """The live field; writing into it edits the model."""
        holder = self._model.opt if name.startswith("opt.") else self._model
        return np.asarray(getattr(holder, name.removeprefix("opt.")))[np.newaxis]

    @property
    def joint_dofs(self) -> NDArray[np.intp]:
        """Degrees of freedom of the twelve joints, canonical order, shape (12,)."""
        return np.arange(FIRST_JOINT_DOF, FIRST_JOINT_DOF + facts.N_JOINTS, dtype=np.intp)

    def body_id(self, name: str) -> int:
        """Number of the body ``name``; raises KeyError with the names there are."""
        return int(self._model.body(name).id)

    def geom_id(self, name: str) -> int:
        """Number of the geom ``name``; raises KeyError with the names there are."""
        return int(self._model.geom(name).id)


def edit_model(model: mujoco.MjModel, effects: Iterable[Effect]) -> None:
    """Let the effects that edit a model edit this one."""
    fields = MujocoFields(model)
    for effect in effects:
        if isinstance(effect, ModelEffect) and not effect.is_null:
            effect.edit(fields)


class PlantFields(MujocoFields):
    """Fields of the MuJoCo model, shape (n_sims, ...), named as in ``MjModel`` (``opt.<name>`` for options).

    Reading a field gives each simulation its own copy from then on. Call :meth:`commit` after writing, so that what
    MuJoCo derives from a field follows.
    """

    def __init__(self, batch: Batch, on_commit: Callable[[], None] = lambda: None) -> None:
        super().__init__(batch.model)
        self._batch, self._on_commit = batch, on_commit
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
        self._on_commit()
