"""The torque loop follows its set-point with a first-order lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueBandwidth(TorqueEffect):
    """T·dτ/dt + τ = τ_asked, discretised exactly for a torque held over one physics step.

    Source: closed torque loops of geared actuators, time constants 2 to 25 ms.
    """

    name: ClassVar[str] = "torque_bandwidth"

    time_constant_s: Any = parameter(null=0.0, low=0.0, high=0.2, unit="s", source="torque loops, 0.002 to 0.025 s")

    def start(self, torque_nm: AnyArray) -> Memory:
        """No torque before the first step."""
        return namespace_of(torque_nm).zeros_like(torque_nm)

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Move the torque towards what was asked."""
        xp = namespace_of(torque_nm)
        at_once = self.time_constant_s <= 0.0
        ones = xp.ones_like(self.time_constant_s)
        keep = xp.exp(-motion.dt_s / xp.where(at_once, ones, self.time_constant_s))
        torque = xp.where(at_once, torque_nm, torque_nm + keep * (memory - torque_nm))
        return torque, torque
