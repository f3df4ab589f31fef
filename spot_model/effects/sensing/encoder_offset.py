"""Zero offsets of the joint encoders."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Draws, JointReading, Memory, SensorEffect, parameter


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
