"""A constant gain of the motor torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueGain(TorqueEffect):
    """Torque times a constant: a wrong motor constant or current scale.

    Source: motor constants vary by 5 to 20 % with temperature and production.
    """

    name: ClassVar[str] = "torque_gain"

    gain: Any = parameter(null=1.0, low=0.1, high=3.0, unit="1", source="0.8 to 1.1 in practice")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Scale the torque."""
        return self.gain * torque_nm, memory
