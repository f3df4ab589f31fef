"""A program that scales the policy's action by a different factor than in training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from array_api_compat import device

from spot_model.effects.base import SoftwareEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.facts import DEFAULT_POSITION_RAD
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class ActionScale(SoftwareEffect):
    """The set-point's distance from the default pose is scaled.

    Source: exported policies run with another action scale, a fault often reported by users.
    """

    name: ClassVar[str] = "action_scale"

    scale: Any = parameter(null=1.0, low=0.1, high=10.0, unit="1", source="0.25 in place of 0.2, say")

    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Scale about the default pose."""
        xp = namespace_of(position_rad)
        rest = xp.asarray(DEFAULT_POSITION_RAD, dtype=position_rad.dtype, device=device(position_rad))
        scaled = position_rad + (self.scale - 1.0) * (position_rad - rest)
        return xp.where(self.mask_like(position_rad), scaled, position_rad)
