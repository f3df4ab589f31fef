"""A low-pass filter on the reported joint velocity."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spot_model.effects.base import JointReading, Memory, SensorEffect, parameter


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

    def read(
        self, reading: JointReading, dt_s: float, memory: Memory, rng: np.random.Generator
    ) -> tuple[JointReading, Memory]:
        """Filter the velocity."""
        tau = np.where(self.mask, self.time_constant_s, 0.0)
        keep = np.where(tau > 0.0, np.exp(-dt_s / np.where(tau > 0.0, tau, math.inf)), 0.0)
        filtered = np.where(
            keep > 0.0, reading.velocity_rad_s + keep * (memory - reading.velocity_rad_s), reading.velocity_rad_s
        )
        servo = reading.servo_velocity_rad_s
        if np.any(np.asarray(self.unfiltered_share) > 0.0):
            servo = filtered + self.unfiltered_share * (reading.velocity_rad_s - filtered)
        return dataclasses.replace(reading, velocity_rad_s=filtered, servo_velocity_rad_s=servo), filtered
