"""Faults that the library does not know: at links and body."""

from __future__ import annotations

import mujoco
import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Built, at, sign
from withheld.realities.faults.body import add_mass
from withheld.realities.hooks import Motion

CABLE_NM_PER_RAD = 9.0
SPRING_NM = 6.0
STOP_NM_PER_RAD = 40.0
WIND_N = 55.0
SLOSH_KG = 6.0
DEFAULT_RAD = facts.DEFAULT_POSITION_RAD


def cable_bundle(ask: Ask) -> Built:
    """A stiff bundle of cables through the hip: abduction and flexion pull on each other."""
    stiffness, ratio = ask.size * CABLE_NM_PER_RAD, float(ask.rng.uniform(0.7, 1.2)) * sign(ask.rng)
    legs = ask.joints[0::3] | ask.joints[1::3]
    return Built(lambda robot: robot.links.append(_Cable(np.where(legs, stiffness, 0.0), ratio)))


def hysteretic_spring(ask: Ask) -> Built:
    """A rubber sleeve around the joint: a spring that gives back less than it took (Bouc and Wen)."""
    return Built(lambda robot: robot.links.append(_Sleeve(at(ask.joints, ask.size * SPRING_NM))))


def rubbing_stop(ask: Ask) -> Built:
    """A stop that stands in the way before the end of the travel: it pushes back, and rubs as hard as it pushes."""
    stiffness = at(ask.joints, ask.size * STOP_NM_PER_RAD)
    side = sign(ask.rng)
    return Built(lambda robot: robot.links.append(_Stop(stiffness, DEFAULT_RAD, side)))


def headwind(ask: Ask) -> Built:
    """Wind with gusts: drag by the square of the air's speed past the body."""
    towards = float(ask.rng.uniform(-np.pi, np.pi))
    part = _Wind(ask.size * WIND_N, towards, ask.rng.uniform(0.0, 2.0 * np.pi, 3))
    return Built(lambda robot: robot.body_forces.append(part) if ask.size > 0.0 else None)


def slosh(ask: Ask) -> Built:
    """Part of the body's own mass hangs on springs: a tank half full. Standing still, nothing is different."""
    mass = ask.size * SLOSH_KG
    hertz = float(ask.rng.uniform(1.6, 2.6))

    def edit(spec: mujoco.MjSpec) -> None:
        body = spec.body("body")
        body.mass -= mass
        com = np.array(facts.BODY.com_m)
        tank = add_mass(spec, "body", "slosh", mass, com, np.full(3, 4e-3 * mass))
        stiffness = mass * (2.0 * np.pi * hertz) ** 2
        for name, axis in (("slosh_x", [1, 0, 0]), ("slosh_y", [0, 1, 0])):
            slide = tank.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
            slide.stiffness[0] = stiffness
            slide.damping[0] = 2.0 * 0.08 * np.sqrt(stiffness * mass)

    return Built(lambda robot: robot.spec_edits.append(edit) if mass > 0.0 else None)


class _Cable:
    def __init__(self, stiffness: Array, ratio: float) -> None:
        self._stiffness, self._ratio = stiffness, ratio

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Pull of ½·k·(hx − r·hy)² about the default pose."""
        off = motion.link_rad - DEFAULT_RAD
        pull = self._stiffness * (off[:, 0::3] - self._ratio * off[:, 1::3])
        out = torque_nm.copy()
        out[:, 0::3] -= pull
        out[:, 1::3] += self._ratio * pull
        return out


class _Sleeve:
    """dz/dt = (v − |v|·|z|·z) / s, τ = −F·(0.5·x + z): x about the default pose, z within ±1."""

    STRETCH_RAD = 0.12

    def __init__(self, level: Array) -> None:
        self._level = level
        self._z: Array = np.zeros((1, len(level)))

    def start(self, n_runs: int) -> None:
        """Relaxed."""
        self._z = np.zeros((n_runs, len(self._level)))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """With the sleeve's pull."""
        v, z = motion.link_rad_s, self._z
        self._z = z + motion.dt_s / self.STRETCH_RAD * (v - np.abs(v) * np.abs(z) * z)
        return np.asarray(torque_nm - self._level * (0.5 * (motion.link_rad - DEFAULT_RAD) / 0.3 + self._z))


class _Stop:
    GRIP = 0.8
    SOFT_RAD_S = 0.1

    def __init__(self, stiffness: Array, begins_rad: Array, side: float) -> None:
        self._stiffness, self._begins, self._side = stiffness, begins_rad, side

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Push back, and rub."""
        depth = np.maximum(self._side * (motion.link_rad - self._begins), 0.0)
        push = self._stiffness * depth
        v = motion.link_rad_s
        return np.asarray(torque_nm - self._side * push - self.GRIP * push * v / (np.abs(v) + self.SOFT_RAD_S))


class _Wind:
    MEAN_M_S = 9.0
    GUSTS = ((0.35, 0.23), (0.25, 0.61), (0.15, 1.37))
    """Share of the mean and frequency, Hz."""

    def __init__(self, force_n: float, towards_rad: float, phases: Array) -> None:
        self._per_square = force_n / self.MEAN_M_S**2
        self._way = np.array([np.cos(towards_rad), np.sin(towards_rad), 0.0])
        self._phases = phases

    def force_n(self, velocity_m_s: Array, time_s: float) -> Array:
        """Drag of the air that passes the body."""
        gusts = sum(
            a * np.sin(2.0 * np.pi * f * time_s + p) for (a, f), p in zip(self.GUSTS, self._phases, strict=True)
        )
        past = self.MEAN_M_S * (1.0 + gusts) * self._way - velocity_m_s
        return np.asarray(self._per_square * np.linalg.norm(past, axis=1, keepdims=True) * past)
