"""Effects as few and wide as they can be: joints of one robot together, and robots of several models together.

A step costs a Python call an effect, whatever the number of joints and robots that it acts on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect, SensorEffect, TorqueEffect
from spot_model.robot import facts
from spot_model.robot.joints import select_joints

Key = tuple[Any, ...]


def compact(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The same effects with those of one kind at different joints as one; a step takes a tenth of the time.

    Parameters are numbers, or have shape (n_sims, 1) or (n_sims, 12).
    """
    groups: list[list[Effect]] = []
    for effect in effects:
        if groups and _may_join(groups[-1], effect):
            groups[-1].append(effect)
        else:
            groups.append([effect])
    return tuple(_over_joints(own) if len(own) > 1 else own[0] for own in groups)


def _may_join(own: Sequence[Effect], effect: Effect) -> bool:
    """Whether an effect is of one kind with others, and at other joints than they."""
    is_by_joint = isinstance(effect, (TorqueEffect, SensorEffect))
    taken = np.any([select_joints(e.joints) for e in own], axis=0)
    return is_by_joint and type(effect) is type(own[0]) and not (taken & select_joints(effect.joints)).any()


def _over_joints(own: Sequence[Effect]) -> Effect:
    """Effects of one kind as one with a number for each joint.

    It acts at all joints, with null values where there was none: models that differ in places alone stay alike in form.
    """
    columns: dict[str, Any] = {}
    for p in own[0].parameters():
        values = [np.asarray(getattr(effect, p.name), dtype=np.float64) for effect in own]
        n = max(v.shape[0] if v.ndim else 1 for v in values)
        column = np.full((n, facts.N_JOINTS), p.null, dtype=np.float64)
        for effect, value in zip(own, values, strict=True):
            mask = select_joints(effect.joints)
            column[:, mask] = np.broadcast_to(value, column.shape)[:, mask]
        columns[p.name] = column
    return replace(own[0], joints=("all",), **columns)


def side_by_side(robots: Sequence[Sequence[Effect]], n_sims: int) -> tuple[Effect, ...]:
    """The effects of simulations of which number i is robot i modulo the number of robots.

    Effects of one kind at the same joints become one, with a row for each simulation; in simulations whose robot lacks
    it, it has its null values. Each robot's effects keep their order.

    Args:
        robots: The effects of each; parameters are numbers.
        n_sims: Simulations.
    """
    if len(robots) == 1:
        return tuple(robots[0])
    keyed = [_keyed(compact(effects)) for effects in robots]
    order: list[Key] = []
    for effects in keyed:
        at = 0
        for key in effects:
            if key in order:
                at = order.index(key) + 1
            else:
                order.insert(at, key)
                at += 1
    which = np.arange(n_sims) % len(robots)
    return tuple(_over_robots([effects.get(key) for effects in keyed], which) for key in order)


def _keyed(effects: Sequence[Effect]) -> dict[Key, Effect]:
    """Effects by class, joints, and how many of the same came before."""
    found: dict[Key, Effect] = {}
    for effect in effects:
        number = sum(key[:2] == (type(effect), effect.joints) for key in found)
        found[type(effect), effect.joints, number] = effect
    return found


def _over_robots(effects: Sequence[Effect | None], which: NDArray[np.int_]) -> Effect:
    some = next(effect for effect in effects if effect is not None)
    columns: dict[str, Any] = {}
    for p in some.parameters():
        values = [np.atleast_2d(p.null if e is None else np.asarray(getattr(e, p.name), np.float64)) for e in effects]
        width = max(v.shape[1] for v in values)
        columns[p.name] = np.concatenate([np.broadcast_to(v, (1, width)) for v in values])[which]
    return replace(some, **columns)
