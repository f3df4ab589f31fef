"""Models side by side, as one whose numbers differ from run to run: one batch costs little more than one model.

A model without an effect that another one has gets it with null values, at which it changes nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np

from spot_model.effects.base import Effect
from spot_model.io.model_file import RobotModel


def merged(models: Sequence[RobotModel]) -> RobotModel | None:
    """One model for a batch whose run i is of ``models[i]``; None where no such model exists.

    Models have plain numbers, or one number a joint, shape (1, J).
    """
    first = models[0]
    if all(m is first for m in models):
        return first
    wide = [np.shape(v) for m in models for e in m.effects for v in e.values.values() if np.ndim(v)]
    if any(m.robot != first.robot for m in models) or any(shape[0] != 1 for shape in wide):
        return None
    order: list[Hashable] = []
    keys = {id(m): [_key(e) for e in m.effects] for m in models}
    for own in keys.values():
        _weave(order, own)
    rows = []
    for model in models:
        at, row = 0, []
        own = keys[id(model)]
        for key in order:
            there = at < len(own) and own[at] == key
            row.append(model.effects[at] if there else None)
            at += there
        rows.append(row)
    return RobotModel(tuple(_merged_effect(column) for column in zip(*rows, strict=True)), first.robot)


def _key(effect: Effect) -> Hashable:
    """What two effects that differ in numbers alone have in common."""
    numbers = {p.name for p in effect.parameters()}
    rest = tuple((f.name, repr(getattr(effect, f.name))) for f in dataclasses.fields(effect) if f.name not in numbers)
    return (type(effect), rest)


def _weave(order: list[Hashable], own: Sequence[Hashable]) -> None:
    """Insert what is missing, so that ``own`` is a subsequence of ``order``."""
    at = 0
    for key in own:
        if key in order[at:]:
            at = order.index(key, at) + 1
        else:
            order.insert(at, key)
            at += 1


def _merged_effect(effects: Sequence[Effect | None]) -> Effect:
    """One effect with a number for each run where they differ; null where a run has none."""
    some = next(e for e in effects if e is not None)
    columns: dict[str, Any] = {}
    for p in some.parameters():
        values = [p.null if e is None else getattr(e, p.name) for e in effects]
        if any(np.ndim(v) for v in values):
            width = max(np.shape(v)[-1] if np.ndim(v) else 1 for v in values)
            columns[p.name] = np.concatenate([np.broadcast_to(v, (1, width)) for v in values]).astype(np.float64)
        elif any(v != values[0] for v in values):
            columns[p.name] = np.array(values, dtype=np.float64)[:, None]
        else:
            columns[p.name] = values[0]
    return dataclasses.replace(some, **columns)
