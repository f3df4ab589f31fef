"""Feet larger or smaller than the model's, by wear or a different tyre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, legs_of, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class FootRadius(ModelEffect):
    """The foot sphere's radius changes; its centre stays. Acts on the legs of ``joints``.

    Source: rubber feet wear by millimetres.
    """

    name: ClassVar[str] = "foot_radius"

    change_m: Any = parameter(null=0.0, low=-0.02, high=0.02, unit="m", source="wear, ±5 mm")

    def edit(self, fields: ModelFields) -> None:
        """Change the radius."""
        size = fields["geom_size"]
        for leg in legs_of(self.mask):
            size[:, fields.geom_id(f"{leg}_foot"), 0] += per_sim(self.change_m)
