"""Models that differ in numbers alone, as one whose numbers differ from run to run: one batch costs little more."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from spot_model.effects.base import Effect
from spot_model.model_file import RobotModel


def merged(models: Sequence[RobotModel]) -> RobotModel | None:
    """One model for a batch whose run i is of ``models[i]``; None where they differ in more than numbers.

    Args:
        models: One a run, each with plain numbers.
    """
    first = models[0]
    if all(m is first for m in models):
        return first
    kinds = [[(type(e), e.joints) for e in m.effects] for m in models]
    if any(k != kinds[0] for k in kinds):
        return None
    effects = []
    for same in zip(*(m.effects for m in models), strict=True):
        one = _merged_effect(same)
        if one is None:
            return None
        effects.append(one)
    return RobotModel(tuple(effects), first.robot)


def _merged_effect(effects: Sequence[Effect]) -> Effect | None:
    numbers = {p.name for p in effects[0].parameters()}
    others = [f.name for f in dataclasses.fields(effects[0]) if f.name not in numbers]
    if any(getattr(e, name) != getattr(effects[0], name) for e in effects for name in others):
        return None
    columns: dict[str, Any] = {}
    for name in numbers:
        values = [getattr(e, name) for e in effects]
        if any(np.ndim(v) != 0 for v in values):
            return None
        if any(v != values[0] for v in values):
            columns[name] = np.array(values, dtype=np.float64)[:, None]
    return dataclasses.replace(effects[0], **columns)
