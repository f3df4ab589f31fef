"""What a drive does to a torque: flux, rotors, windings, current loops, ripple."""

from __future__ import annotations

import numpy as np

from withheld.realities.fault_kind import Ask, Built, at
from withheld.realities.robot import Robot

FLUX_LOSS = 0.2
FLUX_GAIN = 0.1
ROTOR_KG_M2 = 0.06
SOFT_LIMIT_NM = (70.0, 22.0)
"""Of knees at sizes just above 0 and of 1: a tired drive holds less than a gait's peaks."""


def torque_gain(ask: Ask) -> Built:
    """Magnets that lost flux: less torque an ampere, and less back-EMF a rad/s."""
    change = -ask.size * FLUX_LOSS if ask.rng.random() < 0.75 else ask.size * FLUX_GAIN
    factor = np.where(ask.joints, 1.0 + change, 1.0)

    def install(robot: Robot) -> None:
        d = robot.drive
        d.torque_constant = d.torque_constant * factor
        d.no_load_high_rad_s = d.no_load_high_rad_s / factor
        d.no_load_low_rad_s = d.no_load_low_rad_s / factor

    return Built(install, {"torque_gain.gain": 1.0 + change})


def rotor_inertia(ask: Ask) -> Built:
    """A heavier rotor: a flywheel behind the gear's spring."""
    more = ask.size * ROTOR_KG_M2

    def install(robot: Robot) -> None:
        robot.drive.rotor_inertia_kg_m2 = robot.drive.rotor_inertia_kg_m2 + at(ask.joints, more)

    return Built(install, {"armature.inertia_kg_m2": more})
