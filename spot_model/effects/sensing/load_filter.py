"""A low-pass filter on the reported load."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Draws, JointReading, Memory, SensorEffect, parameter
from spot_model.effects.sensing.low_pass import low_pass


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
