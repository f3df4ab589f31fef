"""Dry friction in the joints, as the paper models it: the simulator's friction loss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(ModelEffect):
    """Friction torque that opposes motion up to a constant level.

    Source: the paper's friction parameters (hips 0.008, knees 0.180 N·m identified); MuJoCo ``dof_frictionloss``.
    """

    name: ClassVar[str] = "coulomb_friction"

    level_nm: Any = parameter(null=0.0, low=0.0, high=5.0, unit="N·m", source="the paper's optimised parameters")

    def edit(self, fields: ModelFields) -> None:
        """Add the friction level to the model's friction loss."""
        loss = fields["dof_frictionloss"]
        loss[:, fields.joint_dofs] += self.level_nm * self.mask
