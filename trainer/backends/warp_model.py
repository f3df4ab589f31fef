"""From the CPU plant's model, with its per-simulation fields, to a ``mujoco_warp`` model."""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from mujoco import batch as mujoco_batch

from spot_model.errors import BadInputError
from spot_model.plant.plant import Plant

UNUSED = ("dof_M0",)
"""Derived fields that ``mujoco_warp`` has not and does not use."""


def put_plant(plant: Plant, n: int) -> Any:
    """A model on the current warp device whose fields differ between simulations as the plant's do.

    Raises:
        BadInputError: A field differs between simulations that ``mujoco_warp`` cannot give each its own value of.
    """
    fields = _expanded(plant)
    arrays = {f.name for f in dataclasses.fields(mjw.Model)}
    own: dict[str, np.ndarray[Any, np.dtype[Any]]] = {}
    for name, values in fields.items():
        if name in arrays and _is_batched(name):
            own[name] = values
        elif name not in UNUSED and not np.all(values == values[:1]):
            raise BadInputError(f"model field {name!r} cannot differ between simulations on a GPU; train on the CPU")
    model = mjw.put_model(plant.model, batch_sizes=dict.fromkeys(own, n))
    for name, values in own.items():
        target = wp.to_torch(getattr(model, name))
        target.copy_(torch.tensor(values, dtype=target.dtype).reshape(target.shape))
    model.opt.warn_overflow = 0
    return model


def _expanded(plant: Plant) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    """Every field of the plant that has per-simulation values, derived ones too."""
    found = {}
    for name in sorted(mujoco_batch.MODEL_FIELDS):
        values = plant.batch.expanded(name)
        if values is not None:
            found[name] = values
    return found


def _is_batched(name: str) -> bool:
    """Whether ``mujoco_warp`` lets a field differ between simulations."""
    shapes: dict[str, Any] = {f.name: getattr(f.type, "shape", ()) for f in dataclasses.fields(mjw.Model)}
    return bool(shapes.get(name)) and shapes[name][0] == "*"
