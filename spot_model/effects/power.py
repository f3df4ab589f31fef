"""What battery and heat leave of the motors' torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray

LARGEST_W: Final = 1e9
"""In place of no bound, which no arithmetic holds."""


@dataclass(frozen=True, kw_only=True)
class PowerLimit(TorqueEffect):
    """If mechanical plus copper power of all joints exceeds a bound, driving torques are scaled alike until it is met.

    Power is Σ max(τ·q̇, 0) + r·Σ τ², so copper loss falls with the square of the scale; torques that brake keep theirs.
    ``joints`` says which torques are scaled, the sum is always over all twelve.

    Source: the paper names power-distribution limits as what its model leaves out.
    """

    name: ClassVar[str] = "power_limit"
    by_joint: ClassVar[bool] = False

    power_w: Any = parameter(
        null=math.inf, low=50.0, high=20_000.0, unit="W", source="quadrupeds of 30 kg, 1 to 4 kW peak"
    )
    copper_w_per_nm2: Any = parameter(null=0.0, low=0.0, high=1.0, unit="W/(N·m)²", source="winding resistance / kt²")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Scale the driving torques to the power that is left."""
        xp = namespace_of(torque_nm)
        scale = scale_to_power(torque_nm, motion.velocity_rad_s, self.power_w, self.copper_w_per_nm2)
        return xp.where(torque_nm * motion.velocity_rad_s > 0.0, scale * torque_nm, torque_nm), memory


def scale_to_power(torque_nm: AnyArray, velocity_rad_s: AnyArray, power_w: Any, copper_w_per_nm2: Any) -> AnyArray:
    """What all driving torques are multiplied by so that the drawn power is at most a bound; at most 1.

    The scale s solves c·s² + m·s + b = P, with m the shaft power and c the copper loss of the driving joints, and b the
    copper loss of the others.

    Args:
        torque_nm: Asked for, shape (..., J).
        velocity_rad_s: Shape (..., J).
        power_w: The bound P.
        copper_w_per_nm2: Loss a torque squared.

    Returns:
        Shape (..., 1).
    """
    xp = namespace_of(torque_nm)
    shaft = torque_nm * velocity_rad_s
    heat = copper_w_per_nm2 * torque_nm * torque_nm
    zero = xp.zeros_like(shaft)
    m = xp.sum(xp.where(shaft > 0.0, shaft, zero), axis=-1, keepdims=True)
    c = xp.sum(xp.where(shaft > 0.0, heat, zero), axis=-1, keepdims=True)
    b = xp.sum(xp.where(shaft > 0.0, zero, heat), axis=-1, keepdims=True)
    left = xp.clip(power_w - b, 0.0, LARGEST_W)
    # This form of the root holds without copper loss as well.
    root = xp.sqrt(m * m + 4.0 * c * left)
    scale = 2.0 * left / xp.clip(m + root, 1e-9, LARGEST_W)
    return xp.where(m + c > left, scale, xp.ones_like(m))


@dataclass(frozen=True, kw_only=True)
class BusSag(TorqueEffect):
    """Driving torque is bounded by back-EMF against a bus voltage that falls with the power of all motors.

    The source gives V0 behind a resistance R, and the motors draw P = Σ max(τ·q̇, 0) + c·Σ τ², smoothed over the
    supply's capacitance. From V² − V0·V + R·P = 0 follows V = (V0 + √(V0² − 4·R·P))/2. Where the source cannot give P,
    V is half of V0. A joint's driving torque is bounded by s·(V − k·|q̇|), at least 0.

    Source: a brushless motor at voltage V: τ ≤ (kt/R_phase)·(V − ke·ω), at the joint; a load of constant power behind a
    resistance.
    """

    name: ClassVar[str] = "bus_sag"
    by_joint: ClassVar[bool] = False

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
