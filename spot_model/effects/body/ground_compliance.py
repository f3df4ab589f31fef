"""Ground, or feet, softer than the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, legs_of, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class GroundCompliance(ModelEffect):
    """The contact's time constant grows: a contact gives way further and later. Acts on the legs of ``joints``.

    Source: MuJoCo ``geom_solref``; grass, mats and rubber, 20 to 200 kN/m.
    """

    name: ClassVar[str] = "ground_compliance"

    time_constant_s: Any = parameter(null=0.0, low=0.0, high=0.2, unit="s", source="added to the contact's 0.02 s")

    def edit(self, fields: ModelFields) -> None:
        """Add to the feet's contact time constant."""
        solref = fields["geom_solref"]
        for leg in legs_of(self.mask):
            solref[:, fields.geom_id(f"{leg}_foot"), 0] += per_sim(self.time_constant_s)
