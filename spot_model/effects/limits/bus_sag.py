"""The battery's voltage sags under load, and with it the speed at which motors still give torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class BusSag(TorqueEffect):
    """Driving torque is bounded by back-EMF against a bus voltage that falls with the power of all motors.

    The source gives V0 behind a resistance R, and the motors draw P = Σ max(τ·q̇, 0) + c·Σ τ², smoothed over the
    supply's capacitance: V² − V0·V + R·P = 0, so V = (V0 + √(V0² − 4·R·P))/2, and half of V0 where the source cannot
    give P. A joint's driving torque is bounded by s·(V − k·|q̇|), at least 0.

    Source: a brushless motor at voltage V: τ ≤ (kt/R_phase)·(V − ke·ω), at the joint; a load of constant power behind a
    resistance.
    """

    name: ClassVar[str] = "bus_sag"

    resistance_ohm: Any = parameter(null=0.0, low=0.0, high=2.0, unit="Ω", source="battery and wiring, 0.02 to 0.1 Ω")
    open_voltage_v: Any = parameter(null=55.0, low=10.0, high=100.0, unit="V", source="Spot's battery, about 55 V")
    back_emf_v_s_per_rad: Any = parameter(
        null=0.0, low=0.0, high=10.0, unit="V·s/rad", source="no-load speed 22 to 25 rad/s"
    )
    stall_nm_per_v: Any = parameter(null=1e6, low=0.1, high=1e6, unit="N·m/V", source="stall torque / voltage")
    copper_w_per_nm2: Any = parameter(null=0.0, low=0.0, high=1.0, unit="W/(N·m)²", source="winding resistance / kt²")
    smoothing_s: Any = parameter(null=0.01, low=1e-4, high=1.0, unit="s", source="supply capacitance × resistance")

    def start(self, torque_nm: AnyArray) -> Memory:
        """No power, as a value for each simulation."""
        return namespace_of(torque_nm).zeros_like(torque_nm[:, :1])

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Bound the driving torque by the voltage that is left."""
        xp = namespace_of(torque_nm)
        velocity = motion.velocity_rad_s
        bound = self.bound_nm(memory, velocity)
        driving = torque_nm * velocity > 0.0
        torque = xp.where(driving, xp.minimum(xp.maximum(torque_nm, -bound), bound), torque_nm)
        blend = 1.0 - xp.exp(-motion.dt_s / self.smoothing_s)
        return torque, memory + blend * (self.power_w(torque, velocity) - memory)

    def power_w(self, torque_nm: AnyArray, velocity_rad_s: AnyArray) -> AnyArray:
        """What all motors draw, shape (..., 1), from torque and velocity of shape (..., J)."""
        xp = namespace_of(torque_nm)
        drawn = _positive(torque_nm * velocity_rad_s)
        return xp.sum(drawn + self.copper_w_per_nm2 * torque_nm * torque_nm, axis=-1, keepdims=True)

    def bound_nm(self, power_w: AnyArray, velocity_rad_s: AnyArray) -> AnyArray:
        """Largest driving torque, shape (..., J), while the motors draw a power of shape (..., 1)."""
        xp = namespace_of(velocity_rad_s)
        open_v = self.open_voltage_v
        root = xp.sqrt(_positive(open_v * open_v - 4.0 * self.resistance_ohm * power_w))
        voltage = 0.5 * (open_v + root)
        return self.stall_nm_per_v * _positive(voltage - self.back_emf_v_s_per_rad * xp.abs(velocity_rad_s))


def _positive(value: AnyArray) -> AnyArray:
    """The value where it is positive, else 0; several times faster than a clip, and it runs in every physics step."""
    return 0.5 * (value + abs(value))
