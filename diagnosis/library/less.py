"""Numbers that effects of one kind have in all, and a model with less of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from diagnosis.channels import Array
from spot_model.effects.base import Effect, Parameter
from spot_model.effects.joint_sensors import SensorNoise
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import N_JOINTS
from spot_model.robot.joints import describe_joints

Turned = Callable[[Any], Array]


def sums(effect: type[Effect], p: Parameter) -> tuple[Turned, Turned]:
    """Into numbers that add up where effects stand one after another, 0 for none, and back.

    Factors multiply, so that their logarithms add up; independent noise has variances that do.
    """
    if p.null == 1.0:
        return lambda v: np.log(np.maximum(v, 1e-9)), np.exp
    if issubclass(effect, SensorNoise):
        return lambda v: np.sign(v) * np.square(v), lambda v: np.sign(v) * np.sqrt(np.abs(v))
    return np.asarray, np.asarray


def in_all(model: RobotModel, effect: type[Effect], p: Parameter) -> Array:
    """The sum over a model's effects of a kind, as :func:`sums` has it; shape (12,)."""
    into, _ = sums(effect, p)
    return sum((into(value_by_joint(e, p)) for e in model.effects if isinstance(e, effect)), start=np.zeros(N_JOINTS))


def with_less(model: RobotModel, effect: type[Effect], p: Parameter, less: Array) -> RobotModel:
    """The model's own effects of a kind lowered by joint, as far as they go; ``less`` as :func:`sums` has it."""
    into, back = sums(effect, p)
    effects: list[Effect] = []
    for e in model.effects:
        if not isinstance(e, effect) or not less[e.mask].any():
            effects.append(e)
            continue
        before = into(value_by_joint(e, p))
        after = np.where(e.mask, np.clip(before + less, into(p.low), into(p.high)), 0.0)
        values = np.where(less == 0.0, value_by_joint(e, p), np.clip(back(after), p.low, p.high))
        less = np.where(e.mask, less - (after - before), less)
        for value in np.unique(values[e.mask]):
            own: dict[str, Any] = {p.name: float(value)}
            effects.append(replace(e, joints=describe_joints(e.mask & (values == value)), **own))
    return replace(model, effects=tuple(effects))


def value_by_joint(e: Effect, p: Parameter) -> Array:
    """A parameter of an effect by joint, its null value where it does not act; shape (12,)."""
    return np.where(e.mask, np.broadcast_to(getattr(e, p.name), (1, N_JOINTS))[0], p.null)
