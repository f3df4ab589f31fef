"""Torque that varies with the joint's angle: cogging and gear ripple."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from array_api_compat import array_namespace

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueRipple(TorqueEffect):
    """An added torque a·sin(n·q + φ).

    Source: cogging of permanent-magnet motors seen through a gear; n = pole pairs × gear ratio.
    """

    name: ClassVar[str] = "torque_ripple"

    amplitude_nm: Any = parameter(null=0.0, low=0.0, high=10.0, unit="N·m", source="0.1 to 1.5 N·m")
    cycles_per_rad: Any = parameter(null=50.0, low=1.0, high=2000.0, unit="1/rad", source="pole pairs × gear ratio")
    phase_rad: Any = parameter(null=0.0, low=-3.2, high=3.2, unit="rad", source="where the joint's zero lies")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Add the ripple."""
        xp = array_namespace(torque_nm)
        return torque_nm + self.amplitude_nm * xp.sin(
            self.cycles_per_rad * motion.position_rad + self.phase_rad
        ), memory
