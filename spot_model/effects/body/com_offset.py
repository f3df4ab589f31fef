"""An offset of the body's centre of mass from the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class ComOffset(ModelEffect):
    """The body's centre of mass is moved; its mass and inertia stay.

    Source: batteries, payload rails and cables move it by centimetres.
    """

    name: ClassVar[str] = "com_offset"

    x_m: Any = parameter(null=0.0, low=-0.2, high=0.2, unit="m", source="0 to 5 cm")
    y_m: Any = parameter(null=0.0, low=-0.1, high=0.1, unit="m", source="0 to 5 cm")
    z_m: Any = parameter(null=0.0, low=-0.1, high=0.1, unit="m", source="0 to 5 cm")

    def edit(self, fields: ModelFields) -> None:
        """Move the body's centre of mass."""
        com = fields["body_ipos"]
        body = fields.body_id("body")
        for axis, value in enumerate((self.x_m, self.y_m, self.z_m)):
            com[:, body, axis] += per_sim(value)
