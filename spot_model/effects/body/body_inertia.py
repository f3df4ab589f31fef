"""The body's rotational inertia differs from the model's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import ModelEffect, ModelFields, parameter, per_sim


@dataclass(frozen=True, kw_only=True)
class BodyInertia(ModelEffect):
    """The body's principal inertias are scaled.

    Source: CAD inertias are off by up to 20 %.
    """

    name: ClassVar[str] = "body_inertia"

    scale: Any = parameter(null=1.0, low=0.3, high=3.0, unit="1", source="0.8 to 1.2")

    def edit(self, fields: ModelFields) -> None:
        """Scale the inertias."""
        inertia = fields["body_inertia"]
        body = fields.body_id("body")
        for axis in range(3):
            inertia[:, body, axis] *= per_sim(self.scale)
