"""A constant torque beside what is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueOffset(TorqueEffect):
    """A constant added to the motor torque: a counterbalance, a strained cable, the zero of a motor's current sensor.

    Source: zeros of Hall current sensors are specified to 0.5 to 1 % of full scale; counterbalances carry a leg's own
    weight, several N·m.
    """

    name: ClassVar[str] = "torque_offset"

    offset_nm: Any = parameter(null=0.0, low=-20.0, high=20.0, unit="N·m", source="0.3 N·m; counterbalances up to 10")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Add the constant."""
        return torque_nm + self.offset_nm, memory
