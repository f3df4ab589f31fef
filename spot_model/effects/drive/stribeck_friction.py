"""Extra friction near standstill that fades with speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.effects.friction import built_up
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(TorqueEffect):
    """Torque loss F·exp(−(q̇/v)²)·d, on top of any Coulomb friction, with d the direction in which the joint last moved.

    d builds up over a short distance after each reversal, so a joint at rest is held.

    Source: the Stribeck curve (Armstrong-Hélouvry et al. 1994); +20 to 100 % of Coulomb, v 0.05 to 1 rad/s.
    """

    name: ClassVar[str] = "stribeck_friction"

    level_nm: Any = parameter(null=0.0, low=0.0, high=10.0, unit="N·m", source="20 to 100 % of Coulomb friction")
    speed_rad_s: Any = parameter(null=0.5, low=0.05, high=5.0, unit="rad/s", source="0.05 to 1 rad/s")

    builds_up_rad: Any = parameter(
        null=0.0015, low=1e-4, high=0.1, unit="rad", source="presliding of gears, 0.001 to 0.01 rad"
    )

    def start(self, torque_nm: AnyArray) -> Memory:
        """At rest, and held by nothing yet."""
        return namespace_of(torque_nm).zeros_like(torque_nm)

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Subtract the friction."""
        xp = namespace_of(torque_nm)
        ratio = motion.velocity_rad_s / self.speed_rad_s
        held = built_up(memory, motion.velocity_rad_s, motion.dt_s, self.builds_up_rad)
        return torque_nm - self.level_nm * xp.exp(-ratio * ratio) * held, held
