"""What the joints' sensors report: offsets, compliance, gains, filters and noise."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from spot_model.effects.base import Draws, Effect, JointReading, Memory, SensorEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


def low_pass(
    now: AnyArray, before: AnyArray, time_constant_s: Any, dt_s: float, effect: Effect | None = None
) -> AnyArray:
    """The filtered value; ``now`` itself, bit for bit, where the time constant is 0.

    Args:
        now: The quantity at this instant, shape (n, k).
        before: The filtered one of the previous instant, same shape.
        time_constant_s: Of the filter, broadcasts to ``now``.
        dt_s: Time between the two.
        effect: Filters only its joints, if given.
    """
    xp = namespace_of(now)
    tau = time_constant_s if effect is None else xp.where(effect.mask_like(now), time_constant_s, 0.0)
    keep = xp.where(tau > 0.0, xp.exp(-dt_s / xp.where(tau > 0.0, tau, math.inf)), 0.0)
    return xp.where(keep > 0.0, now + keep * (before - now), now)


@dataclass(frozen=True, kw_only=True)
class EncoderOffset(SensorEffect):
    """A constant added to the reported position; the servo closes its loop on it, too.

    Source: joint calibration, 0.005 to 0.05 rad.
    """

    name: ClassVar[str] = "encoder_offset"

    offset_rad: Any = parameter(null=0.0, low=-0.3, high=0.3, unit="rad", source="calibration, 0.005 to 0.05 rad")

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Add the offset."""
        offset = self.offset_rad * self.mask_like(reading.position_rad)
        return dataclasses.replace(reading, position_rad=reading.position_rad + offset), memory


@dataclass(frozen=True, kw_only=True)
class JointCompliance(SensorEffect):
    """The reported position leads the link's by torque over stiffness, q_meas = q_link + c·τ, quasi-statically.

    Given as compliance, so that 0 means rigid.

    Source: geared robot joints, 500 to 5000 N·m/rad, which is 0.002 to 0.0002 rad/(N·m).
    """

    name: ClassVar[str] = "joint_compliance"

    compliance_rad_per_nm: Any = parameter(
        null=0.0, low=0.0, high=0.02, unit="rad/(N·m)", source="0.0002 to 0.002 rad/(N·m)"
    )

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Add the wind-up."""
        wind_up = self.compliance_rad_per_nm * reading.load_nm * self.mask_like(reading.load_nm)
        return dataclasses.replace(reading, position_rad=reading.position_rad + wind_up), memory


@dataclass(frozen=True, kw_only=True)
class LoadSensorGain(SensorEffect):
    """Reported load = gain · load + bias.

    Source: strain-gauge torque sensors, 1 to 5 % of scale and 0.1 to 1 N·m of zero.
    """

    name: ClassVar[str] = "load_sensor_gain"

    gain: Any = parameter(null=1.0, low=0.2, high=3.0, unit="1", source="0.95 to 1.05")
    bias_nm: Any = parameter(null=0.0, low=-20.0, high=20.0, unit="N·m", source="0.1 to 1 N·m")

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Scale and shift the load."""
        load = namespace_of(reading.load_nm).where(
            self.mask_like(reading.load_nm), self.gain * reading.load_nm + self.bias_nm, reading.load_nm
        )
        return dataclasses.replace(reading, load_nm=load), memory


@dataclass(frozen=True, kw_only=True)
class LoadFilter(SensorEffect):
    """A first-order low pass on the reported load; the motor's torque itself is not late.

    Source: load cells and their amplifiers lag by 0 to 6 ms.
    """

    name: ClassVar[str] = "load_filter"

    time_constant_s: Any = parameter(null=0.0, low=0.0, high=0.1, unit="s", source="load cells, 0 to 0.006 s")

    def start(self, reading: JointReading) -> Memory:
        """Start at the first load."""
        return reading.load_nm

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Filter the load."""
        load = low_pass(reading.load_nm, memory, self.time_constant_s, dt_s, self)
        return dataclasses.replace(reading, load_nm=load), load


@dataclass(frozen=True, kw_only=True)
class VelocityFilter(SensorEffect):
    """A first-order low pass on the reported velocity; the servo may damp by the true one, in part or whole.

    Source: velocities differentiated from encoders are filtered over 1 to 10 ms.
    """

    name: ClassVar[str] = "velocity_filter"

    time_constant_s: Any = parameter(null=0.0, low=0.0, high=0.2, unit="s", source="encoder filters, 0.001 to 0.01 s")
    unfiltered_share: Any = parameter(
        null=0.0, low=0.0, high=1.0, unit="1", source="1 for a servo that runs on the motor's own, faster loop"
    )
    """How much of its damping the servo takes from the velocity before the filter."""

    def start(self, reading: JointReading) -> Memory:
        """Start at the first velocity."""
        return reading.velocity_rad_s

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Filter the velocity."""
        filtered = low_pass(reading.velocity_rad_s, memory, self.time_constant_s, dt_s, self)
        servo = reading.servo_velocity_rad_s
        if self._is_shared:
            servo = filtered + self.unfiltered_share * (reading.velocity_rad_s - filtered)
        return dataclasses.replace(reading, velocity_rad_s=filtered, servo_velocity_rad_s=servo), filtered

    @cached_property
    def _is_shared(self) -> bool:
        """Looked at once: on a GPU each look would make the host wait."""
        return bool((self.unfiltered_share > 0.0).any())


@dataclass(frozen=True, kw_only=True)
class SensorNoise(SensorEffect):
    """Independent Gaussian noise on position, velocity and load at each reading.

    Source: encoders 0.2 to 1 mrad, velocities 0.02 to 0.1 rad/s, torque sensors 0.3 to 1 N·m.
    """

    name: ClassVar[str] = "sensor_noise"

    position_rad: Any = parameter(null=0.0, low=0.0, high=0.05, unit="rad", source="0.0002 to 0.001 rad")
    velocity_rad_s: Any = parameter(null=0.0, low=0.0, high=2.0, unit="rad/s", source="0.02 to 0.1 rad/s")
    load_nm: Any = parameter(null=0.0, low=0.0, high=20.0, unit="N·m", source="0.3 to 1 N·m")

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Add the noise."""

        def noisy(name: str) -> Any:
            value = getattr(reading, name)
            return value + getattr(self, name) * self.mask_like(value) * rng.standard_normal(tuple(value.shape))

        return dataclasses.replace(reading, **{p.name: noisy(p.name) for p in self.parameters()}), memory
