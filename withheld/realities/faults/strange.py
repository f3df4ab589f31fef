"""Faults that the library does not know: at the drives. Each is plausible, and none is a library effect in disguise."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import Ask, Built, at, sign
from withheld.realities.hooks import Motion
from withheld.realities.robot import Robot

BENT_NM = 3.0
STICKY_NM_S_PER_RAD = 1.2
SAG = 0.6
SAG_S = 0.03
LOPSIDED = 0.25
CROSSTALK = 0.2
ENCODER_S_PER_RAD_S = 4.5e-4
MIDDLE_RAD: Array = np.tile([0.0, 1.0, -1.7], 4)


def bent_shaft(ask: Ask) -> Built:
    """A shaft that drags on one side of its turn: dry friction that comes and goes with the angle."""
    level, width = ask.size * BENT_NM, float(ask.rng.uniform(0.12, 0.2))
    centre = MIDDLE_RAD + ask.rng.uniform(-0.15, 0.15, len(MIDDLE_RAD))
    return Built(lambda robot: robot.rotors.append(_Drag(at(ask.joints, level), centre, width, 0.05)))


def sticky_bearing(ask: Ask) -> Built:
    """A bearing with dried grease at one angle: it slows whatever passes there."""
    level, width = ask.size * STICKY_NM_S_PER_RAD, float(ask.rng.uniform(0.06, 0.1))
    centre = MIDDLE_RAD + ask.rng.uniform(-0.1, 0.1, len(MIDDLE_RAD))
    return Built(lambda robot: robot.rotors.append(_Drag(at(ask.joints, level), centre, width, None)))


def reversal_sag(ask: Ask) -> Built:
    """A power stage with dead time: after each change of the torque's sign it gives less for a while."""
    part = _ReversalSag(at(ask.joints, ask.size * SAG), SAG_S)
    return Built(lambda robot: robot.motors.append(part))


def lopsided(ask: Ask) -> Built:
    """A motor that gives less than it should while it drives, and more than it should while it brakes."""
    part = _Lopsided(at(ask.joints, ask.size * LOPSIDED))
    return Built(lambda robot: robot.motors.append(part))


def crosstalk(ask: Ask) -> Built:
    """Phase wires side by side: part of the thigh's current gets into the knee's torque, and the other way."""
    share = sign(ask.rng) * ask.size * CROSSTALK
    part = _Crosstalk(share, ask.joints[1::3] | ask.joints[2::3])
    return Built(lambda robot: robot.motors.append(part))


def slow_encoder(ask: Ask) -> Built:
    """An encoder whose interpolation lags more the faster it turns; the servo believes it, too."""

    def install(robot: Robot) -> None:
        s = robot.sensing
        s.velocity_lag_s_per_rad_s = s.velocity_lag_s_per_rad_s + at(ask.joints, ask.size * ENCODER_S_PER_RAD_S)

    return Built(install)


class _Drag:
    """Friction within a window of angle: dry if a speed is given over which its sign is soft, else viscous."""

    def __init__(self, level: Array, centre: Array, width: float, soft_rad_s: float | None) -> None:
        self._level, self._centre, self._width, self._soft = level, centre, width, soft_rad_s

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Less the drag."""
        there = self._level * np.exp(-np.square((motion.rotor_rad - self._centre) / self._width))
        v = motion.rotor_rad_s
        how = v if self._soft is None else v / (np.abs(v) + self._soft)
        return np.asarray(torque_nm - there * how)


class _ReversalSag:
    def __init__(self, depth: Array, recovery_s: float) -> None:
        self._depth, self._recovery_s = depth, recovery_s
        self._sag: Array = np.zeros((1, len(depth)))
        self._sign: Array = np.ones((1, len(depth)))

    def start(self, n_runs: int) -> None:
        """Recovered."""
        self._sag = np.zeros((n_runs, len(self._depth)))
        self._sign = np.ones((n_runs, len(self._depth)))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """What the stage gives."""
        # A torque under half a newton metre has no direction worth the name.
        now = np.where(np.abs(torque_nm) > 0.5, np.sign(torque_nm), self._sign)
        faded = self._sag * np.exp(-motion.dt_s / self._recovery_s)
        self._sag = np.where(now != self._sign, self._depth, faded)
        self._sign = now
        return np.asarray(torque_nm * (1.0 - self._sag))


class _Lopsided:
    def __init__(self, share: Array) -> None:
        self._share = share

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Less when driving, half as much more when braking."""
        power = torque_nm * motion.rotor_rad_s
        return np.asarray(torque_nm * (1.0 - self._share * np.where(power > 0.0, 1.0, -0.5)))


class _Crosstalk:
    def __init__(self, share: float, legs: np.ndarray) -> None:
        self._share = share * legs

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """With the neighbour's share."""
        out = torque_nm.copy()
        out[:, 1::3] += self._share * torque_nm[:, 2::3]
        out[:, 2::3] += self._share * torque_nm[:, 1::3]
        return out
