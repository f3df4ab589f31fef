"""A model with less of an effect than it has."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.channels import Array
from spot_model.effects.base import Effect, Parameter
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES, N_JOINTS


def with_less(model: RobotModel, effect: type[Effect], p: Parameter, less: Array) -> RobotModel:
    """The model's own effects of a kind lowered by joint, as far as they go; ``less`` is at most 0, shape (12,)."""
    effects: list[Effect] = []
    for e in model.effects:
        if not isinstance(e, effect) or not less[e.mask].any():
            effects.append(e)
            continue
        before = by_joint(e, p)
        after = np.where(e.mask, np.maximum(before + less, p.low), p.null)
        less = np.where(e.mask, less - (after - before), less)
        for value in np.unique(after[e.mask]):
            joints = tuple(name for name, v, on in zip(JOINT_NAMES, after, e.mask, strict=True) if on and v == value)
            values: dict[str, Any] = {p.name: float(value)}
            effects.append(replace(e, joints=joints, **values))
    return replace(model, effects=tuple(effects))


def by_joint(e: Effect, p: Parameter) -> Array:
    """A parameter of an effect by joint, its null value where it does not act; shape (12,)."""
    return np.where(e.mask, np.broadcast_to(getattr(e, p.name), (1, N_JOINTS))[0], p.null)
