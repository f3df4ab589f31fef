"""Faults for which the effect library has no formula."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import Array
from withheld.realities.fault_kind import BODY, JOINT_PLACES, Ask, FaultKind, Parameters, at, sign
from withheld.simulator.robot import Law, Motion, Robot

SECTOR_LOSS: Final = 0.7
SECTOR_RAD: Final = 0.12
CURVED: Final = 0.35
CURVED_AT_NM: Final = 12.0
GRABS_PER_S: Final = 2.0
GRAB_S: Final = 0.06
GRAB_NM: Final = 25.0
LOBES: Final = 5
LOBE_RAD: Final = 0.05
MIXED: Final = 0.3
WIND_M_S: Final = 14.0
DRAG_N_S2_PER_M2: Final = 0.35


def dead_sector(robot: Robot, ask: Ask) -> Parameters:
    """A demagnetised pole: the motor is weak within a sector of its angle."""
    loss = at(ask.joints, ask.size * SECTOR_LOSS)
    centre = facts.DEFAULT_POSITION_RAD + ask.rng.uniform(-0.1, 0.1, 12)

    def law(torque_nm: Array, m: Motion) -> Array:
        return torque_nm * (1.0 - loss * np.exp(-(((m.rotor_rad - centre) / SECTOR_RAD) ** 2)))

    robot.motors.append(Law(law))
    return {}


def curved_amplifier(robot: Robot, ask: Ask) -> Parameters:
    """A stage whose output is a power of what it is asked for: small torques come out larger, large ones smaller."""
    power = 1.0 - at(ask.joints, ask.size * CURVED)

    def law(torque_nm: Array, _: Motion) -> Array:
        return np.sign(torque_nm) * CURVED_AT_NM * (np.abs(torque_nm) / CURVED_AT_NM) ** power

    robot.motors.append(Law(law))
    return {}


class Grabs:
    """A parking brake that touches now and then: each joint by itself, for :data:`GRAB_S`, at moments of its own."""

    def __init__(self, joints: np.ndarray, level_nm: float, seed: int) -> None:
        self._level, self._rng = at(joints, level_nm), np.random.default_rng(seed)
        self._until_s: Array = np.zeros((1, 12))
        self._now_s = 0.0

    def start(self, n_runs: int) -> None:
        """It does not touch."""
        self._until_s, self._now_s = np.full((n_runs, 12), -1.0), 0.0

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """Less what the brake takes."""
        self._now_s += motion.dt_s
        begins = self._rng.random(self._until_s.shape) < GRABS_PER_S * motion.dt_s
        self._until_s = np.where(begins, self._now_s + GRAB_S, self._until_s)
        holds = self._now_s < self._until_s
        return np.asarray(torque_nm - np.where(holds, self._level, 0.0) * np.clip(motion.rotor_rad_s, -1.0, 1.0))


def grabbing_brake(robot: Robot, ask: Ask) -> Parameters:
    """A brake that does not quite let go."""
    seed = int(ask.rng.integers(2**31))
    robot.rotors.append(Grabs(ask.joints, ask.size * GRAB_NM, seed))
    return {}


class Lobes:
    """An encoder ring that is no circle: the reading is off by a wave of the angle, and the rate by its slope."""

    def __init__(self, size_rad: Array, phase_rad: float) -> None:
        self._size, self._phase = size_rad, phase_rad

    def start(self, n_runs: int) -> None:
        """Nothing to remember."""

    def act(self, reading: Array, dt_s: float) -> Array:
        """With the wave."""
        out, angle = reading.copy(), LOBES * reading[:, :12] + self._phase
        out[:, :12] += self._size * np.sin(angle)
        out[:, 12:24] *= 1.0 + LOBES * self._size * np.cos(angle)
        return out


def lobed_encoder(robot: Robot, ask: Ask) -> Parameters:
    """A dented encoder ring."""
    part = Lobes(at(ask.joints, ask.size * LOBE_RAD), float(ask.rng.uniform(-np.pi, np.pi)))
    robot.readings.append(part)
    return {}


class MixedSetpoints:
    """Set-points of the legs' second joints that carry a share of the other side's."""

    def __init__(self, share: float) -> None:
        self._share = share

    def __call__(self, setpoint_rad: Array) -> Array:
        """With the other side's."""
        out = setpoint_rad.copy()
        off = setpoint_rad - facts.DEFAULT_POSITION_RAD
        for mine, other in ((1, 4), (4, 1), (7, 10), (10, 7)):
            out[:, mine] += self._share * off[:, other]
        return out


def mixed_setpoints(robot: Robot, ask: Ask) -> Parameters:
    """A program that blends left and right."""
    part = MixedSetpoints(sign(ask.rng) * ask.size * MIXED)
    robot.setpoints.append(part)
    return {}


class Wind:
    """The drag of a steady wind: it grows with the square of the speed against the air."""

    def __init__(self, wind_m_s: Array) -> None:
        self._wind = wind_m_s

    def __call__(self, velocity_m_s: Array, time_s: float) -> Array:
        """The same law for every run."""
        against = self._wind - velocity_m_s
        return np.asarray(DRAG_N_S2_PER_M2 * np.linalg.norm(against, axis=1, keepdims=True) * against)


def headwind(robot: Robot, ask: Ask) -> Parameters:
    """A gale from one direction."""
    towards = float(ask.rng.uniform(-np.pi, np.pi))
    part = Wind(ask.size * WIND_M_S * np.array([np.cos(towards), np.sin(towards), 0.0]))
    robot.body_forces.append(part)
    return {}


KINDS: Final = (
    FaultKind("dead_sector", "drive", (), JOINT_PLACES, dead_sector),
    FaultKind("curved_amplifier", "drive", (), JOINT_PLACES, curved_amplifier),
    FaultKind("grabbing_brake", "friction", (), ("joint", "type"), grabbing_brake),
    FaultKind("lobed_encoder", "sensing", (), JOINT_PLACES, lobed_encoder),
    FaultKind("mixed_setpoints", "software", (), BODY, mixed_setpoints),
    FaultKind("headwind", "body", (), BODY, headwind),
)
