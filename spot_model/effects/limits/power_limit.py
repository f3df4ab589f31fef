"""A bound on the total power of all motors."""

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
