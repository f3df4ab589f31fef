"""The robot's power distribution gives all motors together only so much."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from array_api_compat import array_namespace

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class PowerLimit(TorqueEffect):
    """If mechanical plus copper power of all joints exceeds a bound, every driving torque is scaled down alike.

    Power is Σ max(τ·q̇, 0) + r·Σ τ²; ``joints`` says which torques are scaled, the sum is always over all twelve.

    Source: the paper names power-distribution limits as what its model leaves out.
    """

    name: ClassVar[str] = "power_limit"

    power_w: Any = parameter(
        null=math.inf, low=50.0, high=20_000.0, unit="W", source="quadrupeds of 30 kg, 1 to 4 kW peak"
    )
    copper_w_per_nm2: Any = parameter(null=0.0, low=0.0, high=1.0, unit="W/(N·m)²", source="winding resistance / kt²")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Scale the driving torques to the power that is left."""
        xp = array_namespace(torque_nm)
        mechanical = torque_nm * motion.velocity_rad_s
        driving = mechanical > 0.0
        power = xp.where(driving, mechanical, xp.zeros_like(mechanical)) + self.copper_w_per_nm2 * torque_nm * torque_nm
        total = xp.sum(power, axis=-1, keepdims=True)
        scale = xp.where(total > self.power_w, self.power_w / xp.clip(total, 1e-9, math.inf), xp.ones_like(total))
        return xp.where(driving & (total > self.power_w), scale * torque_nm, torque_nm), memory
