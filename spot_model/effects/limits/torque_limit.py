"""A flat bound on motor torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import IdleBox, Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueLimit(TorqueEffect):
    """Torque saturates at ± a constant.

    Source: the SDK's hip limit, 45 N·m.
    """

    name: ClassVar[str] = "torque_limit"

    limit_nm: Any = parameter(null=math.inf, low=1.0, high=500.0, unit="N·m", source="SDK: hips 45 N·m")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Clip to ± the limit."""
        xp = namespace_of(torque_nm)
        return xp.minimum(xp.maximum(torque_nm, -self.limit_nm), self.limit_nm), memory

    def idle_box(self) -> IdleBox:
        """Up to the limit."""
        return IdleBox(torque_nm=(-self.limit_nm, self.limit_nm))
