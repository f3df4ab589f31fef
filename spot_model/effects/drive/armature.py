"""Reflected rotor inertia: the motor's own inertia as the joint feels it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter


@dataclass(frozen=True, kw_only=True)
class Armature(ModelEffect):
    """Torque lost to accelerate the rotor, −I·q̈; a sensor behind the gear does not see it.

    Source: rotor inertia × gear ratio²; public estimates for Spot 0.040 (hips) and 0.073 kg·m² (knees).
    """

    name: ClassVar[str] = "armature"

    inertia_kg_m2: Any = parameter(
        null=0.0, low=0.0, high=0.5, unit="kg·m²", source="gear ratio² × rotor, 0.01 to 0.08"
    )

    def edit(self, fields: ModelFields) -> None:
        """Add the inertia to the model's armature."""
        armature = fields["dof_armature"]
        armature[:, fields.joint_dofs] += self.inertia_kg_m2 * self.mask
