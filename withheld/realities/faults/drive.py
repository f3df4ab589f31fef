"""What a drive does to a torque: flux, rotors, current loops, ripple, play, and a servo's own gains."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Built, at, sign
from withheld.realities.hooks import Motion
from withheld.realities.robot import Robot

FLUX_LOSS = 0.2
FLUX_GAIN = 0.1
ROTOR_KG_M2 = 0.06
LAG_S = 0.016
RIPPLE_NM = 1.5
PLAY_RAD = 0.0105
COMPLIANCE_RAD_PER_NM = 0.002
STIFFEST_NM_PER_RAD = 15000.0
FLYWHEEL_HZ = 60.0
FLYWHEEL_DAMPING = 0.7
SERVO_GAIN = 0.2
SERVO_DAMPING = 0.3


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
    """A heavier rotor: a flywheel on a shaft of its own."""
    more = ask.size * ROTOR_KG_M2
    part = _Flywheel(at(ask.joints, more))
    return Built(lambda robot: robot.rotors.append(part), {"armature.inertia_kg_m2": more})


def slow_loop(ask: Ask) -> Built:
    """A current loop of second order."""
    time_s, damping = ask.size * LAG_S, float(ask.rng.uniform(0.75, 0.95))
    part = SecondOrder(np.where(ask.joints, time_s, 0.0), damping)
    return Built(lambda robot: robot.motors.append(part), {"torque_bandwidth.time_constant_s": time_s})


def ripple(ask: Ask) -> Built:
    """Teeth and poles: a fundamental in the joint's angle with two harmonics."""
    size = ask.size * RIPPLE_NM
    order = float(ask.rng.uniform(9.0, 24.0))
    phases = ask.rng.uniform(-np.pi, np.pi, 3)
    part = _Ripple(at(ask.joints, size), order, phases)
    return Built(lambda robot: robot.rotors.append(part), {
        "torque_ripple.amplitude_nm": size, "torque_ripple.cycles_per_rad": order,
        "torque_ripple.phase_rad": float(phases[0]),
    })  # fmt: skip


def play(ask: Ask) -> Built:
    """Teeth that no longer meet: the rotor runs free between them, and hits the other side."""
    gap = ask.size * PLAY_RAD

    def install(robot: Robot) -> None:
        robot.drive.play_rad = robot.drive.play_rad + at(ask.joints, gap)
        robot.drive.is_elastic = robot.drive.is_elastic | (ask.joints & (ask.size > 0.0))

    return Built(install, {"backlash.gap_rad": gap})


def soft_gear(ask: Ask) -> Built:
    """A gear whose spring gives way; the softer, the less it damps."""
    most = STIFFEST_NM_PER_RAD
    compliance = 1.0 / most + ask.size * (COMPLIANCE_RAD_PER_NM - 1.0 / most)

    def install(robot: Robot) -> None:
        if ask.size == 0.0:
            return
        d = robot.drive
        share = 1.0 / (compliance * d.gear_stiffness_nm_per_rad)
        d.gear_stiffness_nm_per_rad = np.where(ask.joints, 1.0 / compliance, d.gear_stiffness_nm_per_rad)
        damping = d.gear_damping_nm_s_per_rad * np.minimum(np.sqrt(share), 1.0)
        d.gear_damping_nm_s_per_rad = np.where(ask.joints, damping, d.gear_damping_nm_s_per_rad)
        d.is_elastic = d.is_elastic | ask.joints

    return Built(install, {"joint_compliance.compliance_rad_per_nm": compliance})


def servo_gains(ask: Ask) -> Built:
    """A robot that takes both gains for less, or more, than it was told: a torque scale before any limit."""
    change = sign(ask.rng) * ask.size * SERVO_GAIN
    factor = np.where(ask.joints, 1.0 + change, 1.0)

    def install(robot: Robot) -> None:
        robot.drive.kp_scale = robot.drive.kp_scale * factor
        robot.drive.kd_scale = robot.drive.kd_scale * factor

    return Built(install, {"torque_gain.gain": 1.0 + change})


def servo_damping(ask: Ask) -> Built:
    """A robot that damps more than it was told: at one set of gains nothing but viscous friction."""
    factor = np.where(ask.joints, 1.0 + ask.size * SERVO_DAMPING, 1.0)

    def install(robot: Robot) -> None:
        robot.drive.kd_scale = robot.drive.kd_scale * factor

    more = ask.size * SERVO_DAMPING * facts.POLICY_KD_NM_S_PER_RAD
    return Built(install, {"viscous_friction.damping_nm_s_per_rad": more})


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


class _Flywheel:
    """A wheel on a shaft that is as stiff as its own inertia asks for: it follows the rotor up to 60 Hz."""

    def __init__(self, inertia: Array) -> None:
        self._inertia = inertia
        self._corner = 2.0 * np.pi * FLYWHEEL_HZ
        self._angle: Array | None = None
        self._rate: Array = np.zeros((1, len(inertia)))

    def start(self, n_runs: int) -> None:
        """Where the rotor is, at rest."""
        self._angle = None
        self._rate = np.zeros((n_runs, len(self._inertia)))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """What the shaft takes from the rotor."""
        if self._angle is None:
            self._angle = motion.rotor_rad.copy()
        pull = self._corner**2 * (motion.rotor_rad - self._angle)
        pull = pull + 2.0 * FLYWHEEL_DAMPING * self._corner * (motion.rotor_rad_s - self._rate)
        self._rate = self._rate + motion.dt_s * pull
        self._angle = self._angle + motion.dt_s * self._rate
        return np.asarray(torque_nm - self._inertia * pull)


class _Ripple:
    SHARES = (1.0, 0.3, 0.15)

    def __init__(self, amplitude: Array, order: float, phases: Array) -> None:
        self._amplitude, self._order, self._phases = amplitude, order, phases

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """With the ripple at the rotor's angle."""
        angle = self._order * motion.rotor_rad
        waves = [
            s * np.sin((k + 1) * angle + p) for k, (s, p) in enumerate(zip(self.SHARES, self._phases, strict=True))
        ]
        return np.asarray(torque_nm + self._amplitude * np.sum(waves, axis=0))
