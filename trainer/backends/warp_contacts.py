"""Ground contacts, read from ``mujoco_warp``'s contact list."""

from __future__ import annotations

from typing import Any

import mujoco
import torch
import warp as wp

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
