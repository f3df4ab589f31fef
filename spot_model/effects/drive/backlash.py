"""Backlash: after a torque reversal the motor crosses the play before it drives again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


class GapMemory(NamedTuple):
    """Where the motor is in the gap (rad, 0 to the gap's width) and how fast it crosses (rad/s)."""

    place_rad: AnyArray
    speed_rad_s: AnyArray


@dataclass(frozen=True, kw_only=True)
class Backlash(TorqueEffect):
    """No torque is passed on while the motor, pushed by its own torque alone, crosses a gap of the given width.

    The rotor moves freely in the gap with the given inertia, and stops without rebound at either side.

    Source: dead-zone models of gear play; 0.1 to 0.6 degrees at the joint.
    """

    name: ClassVar[str] = "backlash"

    gap_rad: Any = parameter(null=0.0, low=0.0, high=0.2, unit="rad", source="0.002 to 0.01 rad at the joint")
    rotor_inertia_kg_m2: Any = parameter(null=0.04, low=0.001, high=0.5, unit="kg·m²", source="reflected rotor inertia")

    def start(self, torque_nm: AnyArray) -> Memory:
        """The motor rests in the middle of the gap."""
        zeros = namespace_of(torque_nm).zeros_like(torque_nm)
        return GapMemory(zeros + 0.5 * self.gap_rad, zeros)

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Pass the torque on where the motor touches the side it pushes against."""
        xp = namespace_of(torque_nm)
        zeros = xp.zeros_like(torque_nm)
        speed = memory.speed_rad_s + motion.dt_s * torque_nm / self.rotor_inertia_kg_m2
        place = memory.place_rad + motion.dt_s * speed
        at_high, at_low = place >= self.gap_rad, place <= 0.0
        touches = (at_high & (torque_nm > 0.0)) | (at_low & (torque_nm < 0.0)) | (self.gap_rad <= 0.0)
        stopped = at_high | at_low
        place = xp.minimum(xp.maximum(place, zeros), zeros + self.gap_rad)
        return xp.where(touches, torque_nm, zeros), GapMemory(place, xp.where(stopped, zeros, speed))
