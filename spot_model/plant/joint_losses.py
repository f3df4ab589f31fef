"""Torque that a model's friction, damping and armature take away between motor and load cell, without a simulation.

They are read off the fields that effects write when they edit the physics model, so a loss is written once, as an edit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect, ModelEffect
from spot_model.errors import BadInputError
from spot_model.plant.model_fields import MujocoFields
from spot_model.robot.facts import Array
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf

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
