"""Extra friction near standstill that fades with speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from array_api_compat import array_namespace

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.effects.friction import smooth_sign
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(TorqueEffect):
    """Torque loss F·exp(−(q̇/v)²)·sign(q̇), on top of any Coulomb friction.

    Source: the Stribeck curve (Armstrong-Hélouvry et al. 1994); +20 to 100 % of Coulomb, v 0.05 to 1 rad/s.
    """

    name: ClassVar[str] = "stribeck_friction"

    level_nm: Any = parameter(null=0.0, low=0.0, high=10.0, unit="N·m", source="20 to 100 % of Coulomb friction")
    speed_rad_s: Any = parameter(null=0.5, low=0.05, high=5.0, unit="rad/s", source="0.05 to 1 rad/s")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Subtract the friction."""
        xp = array_namespace(torque_nm)
        velocity = motion.velocity_rad_s
        ratio = velocity / self.speed_rad_s
        return torque_nm - self.level_nm * xp.exp(-ratio * ratio) * smooth_sign(velocity), memory
