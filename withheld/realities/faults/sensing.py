"""Joint sensors that are off."""

from __future__ import annotations

import numpy as np

from withheld.realities.fault_kind import Ask, Built, at, sign
from withheld.realities.robot import Robot

OFFSET_RAD = 0.05


def encoder_offset(ask: Ask) -> Built:
    """A zero that is off, on a ring that sits a little off centre."""
    offset = sign(ask.rng) * ask.size * OFFSET_RAD
    phase = float(ask.rng.uniform(-np.pi, np.pi))

    def install(robot: Robot) -> None:
        s = robot.sensing
        s.offset_rad = s.offset_rad + at(ask.joints, offset)
        s.eccentricity_rad = s.eccentricity_rad + at(ask.joints, 0.04 * abs(offset))
        if ask.size > 0.0:
            s.eccentricity_phase_rad = np.where(ask.joints, phase, s.eccentricity_phase_rad)

    return Built(install, {"encoder_offset.offset_rad": offset})
