"""Friction beyond what a drive should have, and what a drive does to a torque: flux, current loops, play, gains."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg import expm

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.realities.fault_kind import JOINT_PLACES, Ask, FaultKind, Parameters, at, sign
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


FLUX_LOSS = 0.2
FLUX_GAIN = 0.1
LAG_S = 0.016
PLAY_RAD = 0.0105
SERVO_GAIN = 0.2
SERVO_DAMPING = 0.3


def torque_gain(robot: Robot, ask: Ask) -> Parameters:
    """Magnets that lost flux: less torque an ampere, and less back-EMF a rad/s."""
    change = -ask.size * FLUX_LOSS if ask.rng.random() < 0.75 else ask.size * FLUX_GAIN
    factor = np.where(ask.joints, 1.0 + change, 1.0)

    d = robot.drive
    d.torque_constant = d.torque_constant * factor
    d.no_load_high_rad_s = d.no_load_high_rad_s / factor
    d.no_load_low_rad_s = d.no_load_low_rad_s / factor
    return {"torque_gain.gain": 1.0 + change}


def slow_loop(robot: Robot, ask: Ask) -> Parameters:
    """A current loop of second order."""
    time_s, damping = ask.size * LAG_S, float(ask.rng.uniform(0.75, 0.95))
    part = SecondOrder(np.where(ask.joints, time_s, 0.0), damping)
    robot.motors.append(part)
    return {"torque_bandwidth.time_constant_s": time_s}


def play(robot: Robot, ask: Ask) -> Parameters:
    """Teeth that no longer meet: the rotor runs free between them, and hits the other side."""
    gap = ask.size * PLAY_RAD

    robot.drive.play_rad = robot.drive.play_rad + at(ask.joints, gap)
    robot.drive.is_elastic = robot.drive.is_elastic | (ask.joints & (ask.size > 0.0))
    return {"backlash.gap_rad": gap}


def servo_gains(robot: Robot, ask: Ask) -> Parameters:
    """A robot that takes both gains for less, or more, than it was told: a torque scale before any limit."""
    change = sign(ask.rng) * ask.size * SERVO_GAIN
    factor = np.where(ask.joints, 1.0 + change, 1.0)

    robot.drive.kp_scale = robot.drive.kp_scale * factor
    robot.drive.kd_scale = robot.drive.kd_scale * factor
    return {"torque_gain.gain": 1.0 + change}


def servo_damping(robot: Robot, ask: Ask) -> Parameters:
    """A robot that damps more than it was told: at one set of gains nothing but viscous friction."""
    factor = np.where(ask.joints, 1.0 + ask.size * SERVO_DAMPING, 1.0)

    robot.drive.kd_scale = robot.drive.kd_scale * factor

    more = ask.size * SERVO_DAMPING * facts.POLICY_KD_NM_S_PER_RAD
    return {"viscous_friction.damping_nm_s_per_rad": more}


class SecondOrder:
    """x″ = ω²·(u − x) − 2·ζ·ω·x′, exact for a u that holds over a step; its delay is 2·ζ/ω.

    Args:
        time_s: 2·ζ/ω of each joint, 0 for none. Shape (12,).
        damping: ζ.
    """

    def __init__(self, time_s: Array, damping: float) -> None:
        self._time_s, self._damping = time_s, damping
        self._acts = time_s > 0.0
        self._step: Array | None = None
        self._x: Array = np.zeros((1, len(time_s)))
        self._rate: Array = np.zeros((1, len(time_s)))

    def start(self, n_runs: int) -> None:
        """At rest, without torque."""
        self._x = np.zeros((n_runs, len(self._time_s)))
        self._rate = np.zeros_like(self._x)

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """What the loop gives."""
        if self._step is None:
            self._step = self._matrices(motion.dt_s)
        a = self._step
        off = self._x - torque_nm
        self._x = torque_nm + a[0, 0] * off + a[0, 1] * self._rate
        self._rate = a[1, 0] * off + a[1, 1] * self._rate
        return np.where(self._acts, self._x, torque_nm)

    def _matrices(self, dt_s: float) -> Array:
        """Transition of (x − u, x′) over a step by joint, shape (2, 2, 12)."""
        out = np.zeros((2, 2, len(self._time_s)))
        for joint in np.flatnonzero(self._acts):
            corner = 2.0 * self._damping / self._time_s[joint]
            system = np.array([[0.0, 1.0], [-(corner**2), -2.0 * self._damping * corner]])
            out[:, :, joint] = expm(system * dt_s)
        return out


KINDS: Final = (
    FaultKind("lugre_friction", "friction", ("coulomb_friction",), JOINT_PLACES, coulomb),
    FaultKind("shear_thinning_grease", "friction", ("viscous_friction",), JOINT_PLACES, viscous),
    FaultKind("sticky_start", "friction", ("stribeck_friction",), JOINT_PLACES, stribeck),
    FaultKind("gear_loss", "friction", ("load_friction",), JOINT_PLACES, gear_loss),
    FaultKind("flux_change", "drive", ("torque_gain",), JOINT_PLACES, torque_gain),
    FaultKind("slow_current_loop", "drive", ("torque_bandwidth",), JOINT_PLACES, slow_loop),
    FaultKind("loose_teeth", "drive", ("backlash",), JOINT_PLACES, play),
    FaultKind("servo_gains", "drive", ("torque_gain",), JOINT_PLACES, servo_gains),
    FaultKind("servo_damping", "drive", ("viscous_friction",), JOINT_PLACES, servo_damping),
)
