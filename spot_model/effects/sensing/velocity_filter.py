"""A low-pass filter on the reported joint velocity."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from spot_model.effects.base import Draws, JointReading, Memory, SensorEffect, parameter
from spot_model.effects.sensing.low_pass import low_pass


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
