"""Torque derating of hot motors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class ThermalDerating(TorqueEffect):
    """Torque falls in proportion to the motor's rise over its starting temperature; τ² heats, time cools.

    g = 1 − k·θ, at least 0.2; dθ/dt = h·τ² − θ/T, with θ the rise in K.

    Source: first-order motor thermal models; magnet and copper lose 10 to 30 % over 50 to 80 K.
    """

    name: ClassVar[str] = "thermal_derating"

    loss_per_k: Any = parameter(null=0.0, low=0.0, high=0.1, unit="1/K", source="copper 0.0039/K, magnets 0.001/K")
    heating_k_per_nm2_s: Any = parameter(null=0.002, low=0.0, high=1.0, unit="K/(N²·m²·s)", source="minutes to warm up")
    cooling_time_s: Any = parameter(null=300.0, low=1.0, high=1e5, unit="s", source="motor housings, minutes")

    def start(self, torque_nm: AnyArray) -> Memory:
        """Cold motors."""
        return namespace_of(torque_nm).zeros_like(torque_nm)

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Derate, then heat by what flowed."""
        xp = namespace_of(torque_nm)
        gain = xp.clip(1.0 - self.loss_per_k * memory, 0.2, 1.0)
        torque = gain * torque_nm
        rise = memory + motion.dt_s * (self.heating_k_per_nm2_s * torque * torque - memory / self.cooling_time_s)
        return torque, rise
