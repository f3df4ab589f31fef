"""Faults for which the effect library has no formula."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.realities.fault_kind import BODY, JOINT_PLACES, Ask, FaultKind, Parameters, at, sign
from withheld.simulator.robot import Law, Motion, Robot

SPRING_NM_PER_RAD: Final = 14.0
HARDENS: Final = 6.0
BEARING_NM: Final = 3.5
BEARING_HALF_RAD: Final = 0.2
DROP_OUTS_PER_S: Final = 2.5
DROP_OUT_S: Final = (0.03, 0.12)
ONE_SIDED: Final = 0.3
WANDER_NM, WANDER_S = 3.0, 0.8
DEAD_NM: Final = 4.0
CROSSTALK: Final = 0.25
PENDULUM_KG: Final = 5.0
TUG_N: Final = 60.0
MIDDLE_RAD: Final[Array] = np.tile([0.0, 1.0, -1.6], 4)
DEFAULT_RAD: Final = facts.DEFAULT_POSITION_RAD


def spring(robot: Robot, ask: Ask) -> Parameters:
    """A spring across a joint that hardens with its stretch."""
    stiffness = at(ask.joints, ask.size * SPRING_NM_PER_RAD)
    rest = DEFAULT_RAD + ask.rng.uniform(-0.15, 0.15, 12)

    def law(torque_nm: Array, m: Motion) -> Array:
        stretch = m.link_rad - rest
        return torque_nm - stiffness * stretch * (1.0 + HARDENS * stretch**2)

    robot.links.append(Law(law))
    return {}


def bearing(robot: Robot, ask: Ask) -> Parameters:
    """A bearing that rubs around one angle (a raised cosine)."""
    level = at(ask.joints, ask.size * BEARING_NM)
    centre = MIDDLE_RAD + ask.rng.uniform(-0.15, 0.15, 12)

    def law(torque_nm: Array, m: Motion) -> Array:
        off = np.clip((m.rotor_rad - centre) / BEARING_HALF_RAD, -1.0, 1.0)
        return torque_nm - level * 0.5 * (1.0 + np.cos(np.pi * off)) * np.tanh(m.rotor_rad_s / 0.08)

    robot.rotors.append(Law(law))
    return {}


class DropOuts:
    """A motor that gives nothing for moments that come at random."""

    def __init__(self, joints: np.ndarray, per_s: float, seed: int) -> None:
        self._joints, self._per_s, self._seed = joints, per_s, seed
        self._rngs: list[np.random.Generator] = []
        self._left_s: Array = np.zeros((1, 1))

    def start(self, n_runs: int) -> None:
        """All motors give; every run has its own moments."""
        self._rngs = [np.random.default_rng([self._seed, run]) for run in range(n_runs)]
        self._left_s = np.zeros((n_runs, 1))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Nothing at the joints that are out."""
        for run, rng in enumerate(self._rngs):
            if self._left_s[run, 0] <= 0.0 and rng.random() < self._per_s * motion.dt_s:
                self._left_s[run, 0] = rng.uniform(*DROP_OUT_S)
        is_out = (self._left_s > 0.0) & self._joints
        self._left_s = self._left_s - motion.dt_s
        return np.where(is_out, 0.0, torque_nm)


def drop_outs(robot: Robot, ask: Ask) -> Parameters:
    """A loose connector of one motor."""
    seed = int(ask.rng.integers(2**31))
    robot.motors.append(DropOuts(ask.joints, ask.size * DROP_OUTS_PER_S, seed))
    return {}


def one_sided(robot: Robot, ask: Ask) -> Parameters:
    """An amplifier whose one half is weak: torques of one sign come out smaller."""
    share, side = at(ask.joints, ask.size * ONE_SIDED), sign(ask.rng)
    law = Law(lambda torque, _: torque * (1.0 - np.where(side * torque > 0.0, share, 0.0)))
    robot.motors.append(law)
    return {}


class Wandering:
    """A torque that wanders about zero, with a memory of :data:`WANDER_S`."""

    def __init__(self, sigma: Array, seed: int) -> None:
        self._sigma, self._seed = sigma, seed
        self._rngs: list[np.random.Generator] = []
        self._now: Array = np.zeros((1, 12))

    def start(self, n_runs: int) -> None:
        """At zero; every run wanders by itself."""
        self._rngs = [np.random.default_rng([self._seed, run]) for run in range(n_runs)]
        self._now = np.zeros((n_runs, 12))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """With the wandering torque."""
        keep = np.exp(-motion.dt_s / WANDER_S)
        fresh = np.stack([rng.standard_normal(12) for rng in self._rngs])
        self._now = keep * self._now + np.sqrt(1.0 - keep**2) * fresh
        return np.asarray(torque_nm + self._sigma * self._now)


def wandering(robot: Robot, ask: Ask) -> Parameters:
    """A current sensor whose zero wanders."""
    seed = int(ask.rng.integers(2**31))
    robot.motors.append(Wandering(at(ask.joints, ask.size * WANDER_NM), seed))
    return {}


def dead_zone(robot: Robot, ask: Ask) -> Parameters:
    """A power stage that gives nothing for small torques."""
    dead = at(ask.joints, ask.size * DEAD_NM)
    law = Law(lambda torque, _: np.sign(torque) * np.maximum(np.abs(torque) - dead, 0.0))
    robot.motors.append(law)
    return {}


class Crosstalk:
    """Rates and loads that pick up those of the next joint of the leg."""

    def __init__(self, share: Array) -> None:
        self._share = share

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, reading: Array, dt_s: float) -> Array:
        """With the neighbour's signal."""
        out = reading.copy()
        for first in (12, 24):
            one = reading[:, first : first + 12]
            neighbour = one.reshape(len(one), 4, 3)[:, :, [1, 2, 0]].reshape(one.shape)
            out[:, first : first + 12] += self._share * neighbour
        return out


def crosstalk(robot: Robot, ask: Ask) -> Parameters:
    """Sensor wires side by side."""
    share = at(ask.joints, sign(ask.rng) * ask.size * CROSSTALK)
    robot.readings.append(Crosstalk(share))
    return {}


def pendulum(robot: Robot, ask: Ask) -> Parameters:
    """Part of the body's mass hangs from it and swings."""
    mass, length = ask.size * PENDULUM_KG, float(ask.rng.uniform(0.05, 0.12))

    def edit(spec: mujoco.MjSpec) -> None:
        body = spec.body("body")
        body.mass -= mass
        inertia = np.full(3, 2e-3 * mass)
        bob = body.add_body(
            name="bob",
            pos=[0.0, 0.0, 0.02],
            mass=mass,
            ipos=[0.0, 0.0, -length],
            inertia=inertia,
            explicitinertial=True,
        )
        for name, axis in (("bob_x", [1, 0, 0]), ("bob_y", [0, 1, 0])):
            joint = bob.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
            joint.damping[0] = 0.1 * mass * length**2 * np.sqrt(9.81 / length)

    robot.spec_edits.append(edit)
    return {}


class Tugs:
    """A pull in one direction of the world that comes and goes, as by a lead."""

    def __init__(self, force_n: float, towards_rad: float, period_s: float) -> None:
        self._pull = force_n * np.array([np.cos(towards_rad), np.sin(towards_rad), 0.1])
        self._period_s = period_s

    def __call__(self, velocity_m_s: Array, time_s: float) -> Array:
        """The same for every run."""
        strength = 0.3 + 0.7 * max(0.0, np.sin(2.0 * np.pi * time_s / self._period_s)) ** 2
        return np.tile(strength * self._pull, (len(velocity_m_s), 1))


def tugs(robot: Robot, ask: Ask) -> Parameters:
    """Somebody pulls at a lead."""
    part = Tugs(ask.size * TUG_N, float(ask.rng.uniform(-np.pi, np.pi)), float(ask.rng.uniform(1.5, 3.0)))
    robot.body_forces.append(part)
    return {}


KINDS: Final = (
    FaultKind("hardening_spring", "body", (), JOINT_PLACES, spring),
    FaultKind("rough_bearing", "friction", (), JOINT_PLACES, bearing),
    FaultKind("motor_drop_outs", "drive", (), ("joint",), drop_outs),
    FaultKind("one_sided_stage", "drive", (), JOINT_PLACES, one_sided),
    FaultKind("wandering_zero", "drive", (), JOINT_PLACES, wandering),
    FaultKind("dead_zone", "drive", (), JOINT_PLACES, dead_zone),
    FaultKind("sensor_crosstalk", "sensing", (), ("leg", "all"), crosstalk),
    FaultKind("swinging_mass", "body", (), BODY, pendulum),
    FaultKind("lead", "body", (), BODY, tugs),
)
