"""What motors and gears do with a torque: gains, delays, ripple and play."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
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


N_STEPS: Final = 64
"""Physics steps that are remembered; a longer delay counts as this one."""


@dataclass(frozen=True, kw_only=True)
class TorqueDelay(TorqueEffect):
    """τ(t) = τ_asked(t − d), between two physics steps by the straight line.

    The servo's own answer to the joint's motion is late, too. A delay of commands does not make that answer late;
    unlike this effect, it shows in the robot's receipts of commands.

    Source: dead time of field buses and sampled current loops, 1 to 10 ms.
    """

    name: ClassVar[str] = "torque_delay"

    delay_s: Any = parameter(null=0.0, low=0.0, high=0.03, unit="s", source="field buses and current loops, 1 to 10 ms")

    def start(self, torque_nm: AnyArray) -> Memory:
        """No torque before the first step. Shape (n, 12, :data:`N_STEPS`), newest first."""
        xp = namespace_of(torque_nm)
        return xp.zeros_like(xp.stack([torque_nm] * N_STEPS, axis=-1))

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """The torque that was asked for a delay ago."""
        xp = namespace_of(torque_nm)
        asked = xp.concat([torque_nm[..., None], memory[..., :-1]], axis=-1)
        steps = xp.minimum(self.delay_s / motion.dt_s, xp.ones_like(self.delay_s) * (N_STEPS - 1))
        ages = xp.cumulative_sum(xp.ones_like(asked[:1, :1]), axis=-1) - 1.0
        weight = xp.maximum(1.0 - xp.abs(ages - steps[..., None]), xp.zeros_like(ages))
        late = xp.sum(weight * asked, axis=-1)
        return xp.where(self.delay_s > 0.0, late, torque_nm), asked


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
