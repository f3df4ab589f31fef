"""From the CPU plant's model, with its per-simulation fields, to a ``mujoco_warp`` model."""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from mujoco import batch as mujoco_batch

from spot_model.errors import BadInputError
from spot_model.plant.plant import Plant
from spot_model.robot import facts

Tensor = torch.Tensor

_BODY = facts.N_LEGS
"""Column of everything that is not a foot."""


class GroundContacts:
    """Contact flags of n simulations, computed from the contacts of the last physics step."""

    def __init__(self, model: mujoco.MjModel, data: Any, n: int, device: torch.device) -> None:
        self._n = n
        self._geoms: Tensor = wp.to_torch(data.contact.geom)
        self._world: Tensor = wp.to_torch(data.contact.worldid)
        self._count: Tensor = wp.to_torch(data.nacon)
        column = torch.full((model.ngeom,), _BODY, dtype=torch.long)
        for i, leg in enumerate(facts.LEG_NAMES):
            column[model.geom(f"{leg}_foot").id] = i
        self._column = column.to(device)
        feet = [int(model.geom(f"{leg}_foot").id) for leg in facts.LEG_NAMES]
        spacing = feet[1] - feet[0]
        is_regular = feet == [feet[0] + spacing * i for i in range(facts.N_LEGS)]
        heights: Tensor = wp.to_torch(data.geom_xpos)[:, feet[0] :: spacing, 2]
        self._foot_height_m = heights[:, : facts.N_LEGS] if model.nhfield == 0 and is_regular else None
        self._number = torch.arange(len(self._world), device=device)
        self._flags = torch.zeros((n + 1) * (_BODY + 1), dtype=torch.bool, device=device)
        self._true = torch.ones(len(self._world), dtype=torch.bool, device=device)

    def standing(self) -> Tensor | None:
        """Feet on the ground (bool, (n, 4)) by their height, where the ground is level: few operations."""
        return None if self._foot_height_m is None else self._foot_height_m <= facts.FOOT_RADIUS_M

    def read(self) -> tuple[Tensor, Tensor]:
        """Feet (bool, (n, 4)), and any other part of the robot (bool, (n,))."""
        geoms = self._geoms.long().clamp(min=0)
        # The ground is never a foot, so the smaller column of the two names the part that touches it.
        column = self._column[geoms].amin(dim=-1)
        is_real = self._number < self._count
        row = torch.where(is_real, self._world.long(), self._n)
        self._flags.zero_()
        self._flags.scatter_(0, row * (_BODY + 1) + column, self._true)
        flags = self._flags.view(self._n + 1, _BODY + 1)[: self._n]
        return flags[:, :_BODY].clone(), flags[:, _BODY].clone()


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
