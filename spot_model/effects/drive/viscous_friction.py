"""Friction that grows in proportion to speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter


@dataclass(frozen=True, kw_only=True)
class ViscousFriction(ModelEffect):
    """Torque loss proportional to joint speed; at fixed gains the same as a larger kd.

    Source: MuJoCo ``dof_damping``; 0.02 to 0.3 N·m·s/rad is usual for geared legs (public fits of a Go2: 0.15 to 0.26).
    """

    name: ClassVar[str] = "viscous_friction"

    damping_nm_s_per_rad: Any = parameter(
        null=0.0, low=0.0, high=5.0, unit="N·m·s/rad", source="joint fits, 0.02 to 0.3"
    )

    def edit(self, fields: ModelFields) -> None:
        """Add the damping to the model's."""
        damping = fields["dof_damping"]
        damping[:, fields.joint_dofs] += self.damping_nm_s_per_rad * self.mask
