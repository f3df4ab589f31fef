"""A low-pass filter on the reported load."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from spot_model.effects.base import JointReading, Memory, SensorEffect, parameter


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

    def read(
        self, reading: JointReading, dt_s: float, memory: Memory, rng: np.random.Generator
    ) -> tuple[JointReading, Memory]:
        """Filter the load."""
        tau = np.where(self.mask, self.time_constant_s, 0.0)
        keep = np.where(tau > 0.0, np.exp(-dt_s / np.where(tau > 0.0, tau, math.inf)), 0.0)
        load = np.where(keep > 0.0, reading.load_nm + keep * (memory - reading.load_nm), reading.load_nm)
        return dataclasses.replace(reading, load_nm=load), load
