"""Compliance of the gear: the encoder sits on the motor's side of a spring."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from spot_model.effects.base import Draws, JointReading, Memory, SensorEffect, parameter


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
