"""Friction beyond what a drive should have: bristles, grease, and gears that lose a share of the power they pass."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Parameters, at
from withheld.simulator.robot import Law, Motion, Robot

COULOMB_NM = 1.5
VISCOUS_NM_S_PER_RAD = 0.3
STRIBECK_NM = 2.0
GEAR_LOSS = 0.22
STILL_RAD_S = 0.03


def coulomb(robot: Robot, ask: Ask) -> Parameters:
    """LuGre bristles whose steady level is a dry friction, a little stickier at rest."""
    level, extra = ask.size * COULOMB_NM, float(ask.rng.uniform(0.05, 0.15))

    robot.drive.coulomb_nm = robot.drive.coulomb_nm + at(ask.joints, level)
    robot.drive.stiction_nm = robot.drive.stiction_nm + at(ask.joints, extra * level)
    return {"coulomb_friction.level_nm": level}


def viscous(robot: Robot, ask: Ask) -> Parameters:
    """Thick grease: it shears thinner the faster it goes, τ = c·v / (1 + |v|/v₀)."""
    level, thins = ask.size * VISCOUS_NM_S_PER_RAD, float(ask.rng.uniform(25.0, 45.0))
    # At the 4 rad/s of a walking joint, the straight line of a perfect diagnosis.
    stated, drag = level / (1.0 + 4.0 / thins), at(ask.joints, level)

    def law(torque_nm: Array, m: Motion) -> Array:
        return torque_nm - drag * m.rotor_rad_s / (1.0 + np.abs(m.rotor_rad_s) / thins)

    robot.rotors.append(Law(law))
    return {"viscous_friction.damping_nm_s_per_rad": stated}


def stribeck(robot: Robot, ask: Ask) -> Parameters:
    """Friction near standstill alone: LuGre with a static level and a quick fall."""
    level, speed = ask.size * STRIBECK_NM, float(ask.rng.uniform(0.25, 0.7))

    d = robot.drive
    d.stiction_nm = d.stiction_nm + at(ask.joints, level)
    d.stribeck_rad_s = np.where(ask.joints, speed, d.stribeck_rad_s)
    return {"stribeck_friction.level_nm": level, "stribeck_friction.speed_rad_s": speed}


def gear_loss(robot: Robot, ask: Ask) -> Parameters:
    """A gear that passes a share η of the power on: driving, the motor must bring τ/η; driven, only η·τ reaches it."""
    loss = ask.size * GEAR_LOSS
    back = float(ask.rng.uniform(0.9, 1.1)) * loss
    # As shares of the motor's torque when driving: 1/η − 1 of the load.
    driving, driven = at(ask.joints, loss / (1.0 - loss)), at(ask.joints, back)

    def law(torque_nm: Array, m: Motion) -> Array:
        v, load = m.rotor_rad_s, m.gear_nm
        share = np.where(load * v > 0.0, driving, driven)
        return np.asarray(torque_nm - share * np.abs(load) * v / (np.abs(v) + STILL_RAD_S))

    robot.rotors.append(Law(law))
    return {"load_friction.share": 0.5 * (loss + back)}
