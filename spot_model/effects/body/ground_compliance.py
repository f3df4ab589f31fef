"""Ground, or feet, softer or harder than the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, legs_of, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class GroundCompliance(ModelEffect):
    """Another time constant of the contact of the legs of ``joints``: with a longer one it gives way further and later.

    Source: MuJoCo ``geom_solref``; grass, mats and rubber, 20 to 200 kN/m.
    """

    name: ClassVar[str] = "ground_compliance"

    time_constant_s: Any = parameter(null=0.0, low=-0.015, high=0.2, unit="s", source="added to the contact's 0.02 s")
    damping_ratio: Any = parameter(null=0.0, low=-0.8, high=4.0, unit="1", source="added to the contact's 1")

    def edit(self, fields: ModelFields) -> None:
        """Add to the feet's contact."""
        solref = fields["geom_solref"]
        for leg in legs_of(self.mask):
            foot = fields.geom_id(f"{leg}_foot")
            solref[:, foot, 0] += per_sim(self.time_constant_s)
            solref[:, foot, 1] += per_sim(self.damping_ratio)
