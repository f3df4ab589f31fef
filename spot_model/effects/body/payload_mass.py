"""A payload that the model lacks, or an error of its body mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class PayloadMass(ModelEffect):
    """A point mass fixed to the body, which also moves the centre of mass and adds inertia.

    Source: the paper randomises ±2.5 kg; Spot carries up to 14 kg.
    """

    name: ClassVar[str] = "payload_mass"

    mass_kg: Any = parameter(null=0.0, low=-5.0, high=20.0, unit="kg", source="the paper ±2.5 kg; data sheet 14 kg")
    x_m: Any = parameter(null=0.0, low=-0.5, high=0.5, unit="m", source="rails on the back")
    y_m: Any = parameter(null=0.0, low=-0.2, high=0.2, unit="m", source="rails on the back")
    z_m: Any = parameter(null=0.0, low=-0.3, high=0.5, unit="m", source="rails on the back")

    def edit(self, fields: ModelFields) -> None:
        """Add the mass, shift the centre of mass, add the inertia about the principal axes (parallel-axis theorem)."""
        body = fields.body_id("body")
        mass, com, inertia = fields["body_mass"], fields["body_ipos"], fields["body_inertia"]
        old = mass[:, body] + 0.0
        added = per_sim(self.mass_kg) + 0.0 * old
        new = old + added
        reduced = old * added / new
        offsets = [per_sim(v) - com[:, body, axis] for axis, v in enumerate((self.x_m, self.y_m, self.z_m))]
        for axis in range(3):
            others = [offsets[k] for k in range(3) if k != axis]
            inertia[:, body, axis] += reduced * (others[0] * others[0] + others[1] * others[1])
            com[:, body, axis] += offsets[axis] * added / new
        mass[:, body] += added
