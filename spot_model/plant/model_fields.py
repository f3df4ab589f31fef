"""The fields of MuJoCo models, of one or a value each simulation, as effects and randomisation read and write them.

The torque that friction, damping and armature take away between motor and load cell is read off the fields that effects
write, without a simulation, so a loss is written once, as an edit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_model.effects.base import Effect, ModelEffect
from spot_model.errors import BadInputError
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf

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

    def restart(self) -> None:
        """Take back all that was written; call :meth:`commit` afterwards."""
        for name in self._names:
            self._batch.expand(name)[...] = MujocoFields.__getitem__(self, name)

    def commit(self) -> None:
        """Bring derived constants up to date with what was written."""
        derives = set(mujoco.MjModel._setconst_inputs)
        if any(name in derives or name.startswith("opt.") for name in self._names):
            self._batch.set_const()
        self._on_commit()


LOSSES: Final = ("dof_frictionloss", "dof_damping", "dof_armature")
"""Fields of a MuJoCo model whose torque a load cell behind the gear does not see."""


@dataclass(frozen=True)
class LossMotion:
    """How joints move, as far as a loss between motor and load cell depends on it; arrays of shape (n, 12)."""

    velocity_rad_s: Array
    acceleration_rad_s2: Array
    direction: Array
    """Sign of the velocity, and less than 1 in size where it is in doubt."""


def joint_losses_nm(effects: Iterable[Effect], motion: LossMotion) -> Array:
    """Torque that all effects together take away between motor and load cell, shape (n, 12), N·m."""
    total = np.zeros_like(motion.velocity_rad_s, dtype=np.float64)
    for effect in effects:
        if isinstance(effect, ModelEffect) and not effect.is_null:
            friction, damping, armature = _written(effect)
            total += friction * motion.direction
            total += damping * motion.velocity_rad_s + armature * motion.acceleration_rad_s2
    return total


def has_joint_loss(effect: Effect) -> bool:
    """Whether any parameter of the effect changes a loss between motor and load cell, whatever its value is now."""
    return isinstance(effect, ModelEffect) and any(np.any(_written(other)) for other in _elsewhere(effect))


def _elsewhere(effect: ModelEffect) -> Iterable[ModelEffect]:
    """The effect, and the effect with each parameter between its null value and a bound."""
    yield effect
    for p in effect.parameters():
        far = p.high if math.isfinite(p.high) else p.low
        near = p.null if math.isfinite(p.null) else p.low
        moved: dict[str, Any] = {p.name: 0.5 * (far + near)}
        try:
            yield replace(effect, **moved)
        except BadInputError:  # parameters that belong together
            continue


def _written(effect: ModelEffect) -> tuple[Array, Array, Array]:
    """What the effect adds to friction loss, damping and armature of the joints, each of shape (1, 12)."""
    fields = _Copies(_bare_model())
    effect.edit(fields)
    before = _Copies(_bare_model())
    friction, damping, armature = ((fields[f] - before[f])[:, fields.joint_dofs] for f in LOSSES)
    return friction, damping, armature


@cache
def _bare_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(collision="feet", visuals=False)))


class _Copies(MujocoFields):
    """Copies of a model's fields for an effect to write into, with a leading axis of one simulation."""

    def __init__(self, model: mujoco.MjModel) -> None:
        super().__init__(model)
        self._fields: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._fields:
            self._fields[name] = super().__getitem__(name).copy()
        return self._fields[name]
