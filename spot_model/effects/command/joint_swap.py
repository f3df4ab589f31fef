"""A program that exchanges left and right joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spot_model.effects.base import SoftwareEffect, parameter
from spot_model.robot.rotation import AnyArray

LEFT_RIGHT = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""The joint on the other side, for each joint in canonical order."""


@dataclass(frozen=True, kw_only=True)
class JointSwap(SoftwareEffect):
    """The set-points of the chosen joints are blended with those of the other side.

    A full swap has share 1; choose both sides of a joint (``hx``) for a true exchange.

    Source: exported policies run in another joint order, a fault often reported by users.
    """

    name: ClassVar[str] = "joint_swap"

    share: Any = parameter(null=0.0, low=0.0, high=1.0, unit="1", source="1 for a swap")

    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Blend with the other side."""
        other = position_rad[:, LEFT_RIGHT]
        return position_rad + self.share * self.mask_like(position_rad) * (other - position_rad)
