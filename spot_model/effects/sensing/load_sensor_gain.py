"""Gain and bias of the torque sensors."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Draws, JointReading, Memory, SensorEffect, parameter
from spot_model.robot.arrays import namespace_of


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
