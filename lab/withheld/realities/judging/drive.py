"""Friction (Maxwell slip, Eyring, teeth under load) and drives: gain, rotors, current loops, cogging, play, gears."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import JOINT_PLACES, Ask, FaultKind, Parameters, at, sign
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


GAIN_LOSS, GAIN_MORE = 0.22, 0.12
ROTOR_KG_M2: Final = 0.06
LAG_S: Final = 0.016
COGGING_NM: Final = 1.5
PLAY_RAD: Final = 0.0175
"""One degree."""
COMPLIANCE_RAD_PER_NM: Final = 0.002


def gain(robot: Robot, ask: Ask) -> Parameters:
    """An amplifier whose current sensor is off: every torque is scaled."""
    change = -ask.size * GAIN_LOSS if ask.rng.random() < 0.7 else ask.size * GAIN_MORE
    factor = 1.0 + at(ask.joints, change)
    robot.motors.append(Law(lambda torque, _: factor * torque))
    return {"torque_gain.gain": 1.0 + change}


def rotor(robot: Robot, ask: Ask) -> Parameters:
    """More inertia on the rotor's shaft."""
    more = ask.size * ROTOR_KG_M2

    robot.drive.rotor_inertia_kg_m2 = robot.drive.rotor_inertia_kg_m2 + at(ask.joints, more)
    return {"armature.inertia_kg_m2": more}


class TwoLags:
    """Two equal first-order lags in a row, together as late as ``delay_s`` for slow signals."""

    def __init__(self, delay_s: Array) -> None:
        self._half_s = np.maximum(0.5 * delay_s, 1e-9)
        self._acts = delay_s > 0.0
        self._first: Array = np.zeros((1, 12))
        self._second: Array = np.zeros((1, 12))

    def start(self, n_runs: int) -> None:
        """Without torque."""
        self._first, self._second = np.zeros((n_runs, 12)), np.zeros((n_runs, 12))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """The second lag's output."""
        blend = -np.expm1(-motion.dt_s / self._half_s)
        self._first = self._first + blend * (torque_nm - self._first)
        self._second = self._second + blend * (self._first - self._second)
        return np.where(self._acts, self._second, torque_nm)


def lag(robot: Robot, ask: Ask) -> Parameters:
    """A current loop with a filter behind it."""
    delay_s = ask.size * LAG_S
    robot.motors.append(TwoLags(at(ask.joints, delay_s)))
    return {"torque_bandwidth.time_constant_s": delay_s}


def cogging(robot: Robot, ask: Ask) -> Parameters:
    """Cogging as a triangle over the angle; stated is its fundamental."""
    size, order = ask.size * COGGING_NM, float(ask.rng.uniform(9.0, 24.0))
    phase = float(ask.rng.uniform(-np.pi, np.pi))
    peak = at(ask.joints, size * np.pi**2 / 8.0)

    def law(torque_nm: Array, m: Motion) -> Array:
        return torque_nm + peak * (2.0 / np.pi) * np.arcsin(np.sin(order * m.rotor_rad + phase))

    robot.rotors.append(Law(law))
    return {"torque_ripple.amplitude_nm": size, "torque_ripple.cycles_per_rad": order}


def play(robot: Robot, ask: Ask) -> Parameters:
    """Play between the teeth: the rotor runs free and hits the other side."""
    gap = ask.size * PLAY_RAD

    robot.drive.play_rad = robot.drive.play_rad + at(ask.joints, gap)
    robot.drive.is_elastic = robot.drive.is_elastic | ask.joints
    return {"backlash.gap_rad": gap}


def soft_gear(robot: Robot, ask: Ask) -> Parameters:
    """A gear that gives."""
    compliance = ask.size * COMPLIANCE_RAD_PER_NM

    d = robot.drive
    share = 1.0 / (compliance * d.gear_stiffness_nm_per_rad)
    d.gear_damping_nm_s_per_rad = np.where(
        ask.joints, d.gear_damping_nm_s_per_rad * np.sqrt(np.minimum(share, 1.0)), d.gear_damping_nm_s_per_rad
    )
    d.gear_stiffness_nm_per_rad = np.where(ask.joints, 1.0 / compliance, d.gear_stiffness_nm_per_rad)
    d.is_elastic = d.is_elastic | ask.joints
    return {"joint_compliance.compliance_rad_per_nm": compliance}


def stiff_servo(robot: Robot, ask: Ask) -> Parameters:
    """A servo that takes both gains for more, or less, than it was told."""
    change = sign(ask.rng) * ask.size * GAIN_LOSS
    factor = 1.0 + at(ask.joints, change)

    robot.drive.kp_scale, robot.drive.kd_scale = robot.drive.kp_scale * factor, robot.drive.kd_scale * factor
    return {"torque_gain.gain": 1.0 + change}


KINDS: Final = (
    FaultKind("dry_bearing", "friction", ("coulomb_friction",), JOINT_PLACES, dry),
    FaultKind("thick_lubricant", "friction", ("viscous_friction",), JOINT_PLACES, grease),
    FaultKind("sticking_seal", "friction", ("stribeck_friction",), JOINT_PLACES, stick),
    FaultKind("rubbing_teeth", "friction", ("load_friction",), JOINT_PLACES, load),
    FaultKind("amplifier_gain", "drive", ("torque_gain",), JOINT_PLACES, gain),
    FaultKind("misread_gains", "drive", ("torque_gain",), JOINT_PLACES, stiff_servo),
    FaultKind("loaded_rotor", "drive", ("armature",), JOINT_PLACES, rotor),
    FaultKind("filtered_current", "drive", ("torque_bandwidth",), JOINT_PLACES, lag),
    FaultKind("cogging", "drive", ("torque_ripple",), JOINT_PLACES, cogging),
    FaultKind("worn_teeth", "drive", ("backlash",), JOINT_PLACES, play),
    FaultKind("yielding_gear", "drive", ("joint_compliance",), JOINT_PLACES, soft_gear),
)
