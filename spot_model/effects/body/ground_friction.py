"""Ground more or less slippery than the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, legs_of, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class GroundFriction(ModelEffect):
    """The sliding friction coefficient between foot and ground, 0.8 in the simulator, is scaled.

    Acts on the legs of ``joints``.

    Source: the paper randomises static friction in 0.3 to 1.0.
    """

    name: ClassVar[str] = "ground_friction"

    scale: Any = parameter(null=1.0, low=0.05, high=3.0, unit="1", source="coefficients 0.3 to 1.0")

    def edit(self, fields: ModelFields) -> None:
        """Scale the feet's friction, which the contact takes over the ground's."""
        friction = fields["geom_friction"]
        for leg in legs_of(self.mask):
            friction[:, fields.geom_id(f"{leg}_foot"), 0] *= per_sim(self.scale)
