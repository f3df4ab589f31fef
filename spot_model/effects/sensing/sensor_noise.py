"""White noise on what the joints' sensors report."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Draws, JointReading, Memory, SensorEffect, parameter


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
