"""Friction: Maxwell slip elements, Eyring's law of lubricants, and elements pressed together by the load."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import JOINT_PLACES, Ask, FaultKind, Parameters, at
from withheld.simulator.robot import Law, Motion, Robot

DRY_NM: Final = 1.5
GREASE_NM_S_PER_RAD: Final = 0.3
TYPICAL_RAD_S: Final = 4.0
"""Speed of a walking joint, at which a curved law is compared with a straight line."""
STICK_NM: Final = 2.0
LOAD_SHARE: Final = 0.22
STIFF_RAD: Final = np.array([4e-4, 1.2e-3, 3e-3])
WEIGHTS: Final = np.array([0.4, 0.35, 0.25])
"""Deflection at which each Maxwell element slips, and its share of the whole."""

Level = Callable[[Motion], Array]


class MaxwellSlip:
    """Springs in parallel, each of which slips at its own deflection; sliding steadily they give ``level``.

    Source: Lampaert, Al-Bender, Swevers 2003, the generalized Maxwell slip model, here without its sliding dynamics.
    """

    def __init__(self, level: Level) -> None:
        self._level = level
        self._bend: Array = np.zeros((len(STIFF_RAD), 1, 12))

    def start(self, n_runs: int) -> None:
        """Relaxed."""
        self._bend = np.zeros((len(STIFF_RAD), n_runs, 12))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Less the elements' pull."""
        most = STIFF_RAD[:, None, None]
        self._bend = np.clip(self._bend + motion.dt_s * motion.rotor_rad_s, -most, most)
        share = np.tensordot(WEIGHTS / STIFF_RAD, self._bend, axes=1)
        return np.asarray(torque_nm - self._level(motion) * share)


def dry(robot: Robot, ask: Ask) -> Parameters:
    """Dry friction with presliding."""
    level = ask.size * DRY_NM
    part = MaxwellSlip(lambda _: at(ask.joints, level))
    robot.rotors.append(part)
    return {"coulomb_friction.level_nm": level}


def grease(robot: Robot, ask: Ask) -> Parameters:
    """A lubricant that flows by Eyring's law, τ = F·asinh(v/v₀): straight at first, then bent."""
    bends = float(ask.rng.uniform(8.0, 16.0))
    scale = at(ask.joints, ask.size * GREASE_NM_S_PER_RAD * bends)
    stated = float(scale.max() * np.arcsinh(TYPICAL_RAD_S / bends) / TYPICAL_RAD_S)
    part = Law(lambda torque, m: torque - scale * np.arcsinh(m.rotor_rad_s / bends))
    robot.rotors.append(part)
    return {"viscous_friction.damping_nm_s_per_rad": stated}


def stick(robot: Robot, ask: Ask) -> Parameters:
    """Friction near standstill that falls by Hess and Soom's law."""
    level, speed = ask.size * STICK_NM, float(ask.rng.uniform(0.3, 0.8))
    part = MaxwellSlip(lambda m: at(ask.joints, level) / (1.0 + np.square(m.rotor_rad_s / speed)))
    robot.rotors.append(part)
    return {"stribeck_friction.level_nm": level}


def load(robot: Robot, ask: Ask) -> Parameters:
    """Teeth that rub in proportion to the torque that they pass on."""
    share = ask.size * LOAD_SHARE
    part = MaxwellSlip(lambda m: at(ask.joints, share) * np.abs(m.gear_nm))
    robot.rotors.append(part)
    return {"load_friction.share": share}


KINDS: Final = (
    FaultKind("dry_bearing", "friction", ("coulomb_friction",), JOINT_PLACES, dry),
    FaultKind("thick_lubricant", "friction", ("viscous_friction",), JOINT_PLACES, grease),
    FaultKind("sticking_seal", "friction", ("stribeck_friction",), JOINT_PLACES, stick),
    FaultKind("rubbing_teeth", "friction", ("load_friction",), JOINT_PLACES, load),
)
