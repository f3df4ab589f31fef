"""Torque that varies with the joint's angle: cogging and gear ripple."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueRipple(TorqueEffect):
    """An added torque a·sin(n·q + φ) + b·sin(2n·q + ψ).

    Source: cogging of permanent-magnet motors seen through a gear; n = pole pairs × gear ratio. Poles and teeth are no
    sines, so there is a second harmonic, too.
    """

    name: ClassVar[str] = "torque_ripple"

    amplitude_nm: Any = parameter(null=0.0, low=0.0, high=10.0, unit="N·m", source="0.1 to 1.5 N·m")
    cycles_per_rad: Any = parameter(null=50.0, low=1.0, high=2000.0, unit="1/rad", source="pole pairs × gear ratio")
    phase_rad: Any = parameter(null=0.0, low=-3.2, high=3.2, unit="rad", source="where the joint's zero lies")
    second_nm: Any = parameter(null=0.0, low=0.0, high=10.0, unit="N·m", source="up to a half of the first")
    second_phase_rad: Any = parameter(null=0.0, low=-3.2, high=3.2, unit="rad", source="where the joint's zero lies")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Add the ripple."""
        xp = namespace_of(torque_nm)
        angle = self.cycles_per_rad * motion.position_rad
        first = self.amplitude_nm * xp.sin(angle + self.phase_rad)
        return torque_nm + first + self.second_nm * xp.sin(2.0 * angle + self.second_phase_rad), memory
