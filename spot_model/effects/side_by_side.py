"""Effects as few and wide as they can be: joints of one robot together, and robots of several models together.

A step costs a Python call an effect, whatever the number of joints and robots that it acts on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from difflib import SequenceMatcher
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect, Hook
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
    taken = np.any([select_joints(e.joints) for e in own], axis=0)
    return effect.by_joint and type(effect) is type(own[0]) and not (taken & select_joints(effect.joints)).any()


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


def side_by_side(robots: Sequence[Sequence[Effect]], which: int | NDArray[np.int_]) -> tuple[Effect, ...]:
    """The effects of simulations, as one chain with a row for each where their numbers differ.

    Effects of one kind become one, at any joints where each joint is on its own; a simulation whose robot lacks it has
    its null values. At each hook a robot's effects keep their order.

    Args:
        robots: The effects of each; parameters are numbers, or have shape (1, 12).
        which: Number of the robot of each simulation, or how many simulations take the robots by turns.
    """
    if len(robots) == 1:
        return tuple(robots[0])
    numbers = np.arange(which) % len(robots) if isinstance(which, int) else which
    wide = [compact(effects) for effects in robots]
    return tuple(effect for hook in Hook for effect in _woven(wide, hook, numbers))


def _woven(robots: Sequence[Sequence[Effect]], hook: Hook, which: NDArray[np.int_]) -> list[Effect]:
    """The effects of one hook, in an order that contains that of each robot."""
    robots = [[effect for effect in effects if effect.hook is hook] for effects in robots]
    keyed = [[_key(effect) for effect in effects] for effects in robots]
    order: list[Key] = []
    for keys in keyed:
        steps = SequenceMatcher(None, order, keys, autojunk=False).get_opcodes()
        order = [key for tag, i, j, k, m in steps for key in order[i:j] + (keys[k:m] if tag != "equal" else [])]
    rows = []
    for keys, effects in zip(keyed, robots, strict=True):
        left = list(zip(keys, effects, strict=True))
        rows.append([left.pop(0)[1] if left and left[0][0] == key else None for key in order])
    return [_over_robots(column, which) for column in zip(*rows, strict=True) if any(column)]


def _key(effect: Effect) -> Key:
    """What effects have in common that one can stand for."""
    apart = {p.name for p in effect.parameters()} | ({"joints"} if effect.by_joint else set())
    return (type(effect), *(repr(getattr(effect, f.name)) for f in fields(effect) if f.name not in apart))


def _over_robots(effects: Sequence[Effect | None], which: NDArray[np.int_]) -> Effect:
    some = next(effect for effect in effects if effect is not None)
    if any(effect is not None and effect.joints != some.joints for effect in effects):
        effects = [effect and _over_joints([effect]) for effect in effects]
        some = next(effect for effect in effects if effect is not None)
    columns: dict[str, Any] = {}
    for p in some.parameters():
        values = [np.atleast_2d(p.null if e is None else np.asarray(getattr(e, p.name), np.float64)) for e in effects]
        width = max(v.shape[1] for v in values)
        rows = np.concatenate([np.broadcast_to(v, (1, width)) for v in values])
        # One number serves all where it can.
        columns[p.name] = float(rows[0, 0]) if (rows == rows[0, 0]).all() else rows[which]
    return replace(some, **columns)
