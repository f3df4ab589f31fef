"""A program that adds the policy's action to a different default pose than in training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import SoftwareEffect, parameter
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class DefaultPose(SoftwareEffect):
    """A constant added to the set-points.

    Source: exported policies run with another default pose, a fault often reported by users.
    """

    name: ClassVar[str] = "default_pose"

    offset_rad: Any = parameter(null=0.0, low=-1.0, high=1.0, unit="rad", source="hind hips 1.1 in place of 0.9, say")

    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Add the offset."""
        return position_rad + self.offset_rad * self.mask_like(position_rad)
