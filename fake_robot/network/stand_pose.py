"""How a standing body is held."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StandPose:
    """Where a standing body shall be: offsets from the nominal stand over its feet (x forward, y left, z up)."""

    forward_m: float = 0.0
    left_m: float = 0.0
    height_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    after_s: float = 0.0
    """When it shall be there, from now on; it takes longer where that is too soon."""
