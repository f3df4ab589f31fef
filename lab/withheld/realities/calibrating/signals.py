"""Commands that come late, unevenly, or not at all; sensors that are off; and a lazy state estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from spot_model.robot.facts import Array
from withheld.realities.fault_kind import BODY, JOINT_PLACES, Ask, FaultKind, Parameters, at, sign
from withheld.simulator.robot import Robot

DELAY_S = 0.012
JITTER_S = 0.004
LOSS = 0.05


def delay(robot: Robot, ask: Ask) -> Parameters:
    """A queue on the way: a wait that wanders slowly about its mean."""
    mean = ask.size * DELAY_S
    robot.delays.append(_Queue(mean))
    return {"command_delay.delay_s": mean}


def jitter(robot: Robot, ask: Ask) -> Parameters:
    """A link that stutters: short waits as a rule, long ones now and then (Weibull)."""
    mean = ask.size * JITTER_S
    robot.delays.append(_Stutter(mean))
    return {"command_jitter.mean_s": mean}


def losses(robot: Robot, ask: Ask) -> Parameters:
    """A link that loses commands in bursts (Gilbert and Elliott's two states)."""
    share = ask.size * LOSS
    robot.delays.append(_Bursts(share))
    return {"command_drop.probability": share}


@dataclass(frozen=True)
class _Queue:
    mean_s: float
    WANDER = 0.06
    MEMORY = 0.97

    def __call__(self, n_commands: int, rng: np.random.Generator) -> Array:
        """A mean and a first-order random walk about it."""
        steps = rng.standard_normal(n_commands) * np.sqrt(1.0 - self.MEMORY**2)
        walk = np.empty(n_commands)
        now = 0.0
        for i, step in enumerate(steps.tolist()):
            now = self.MEMORY * now + step
            walk[i] = now
        return np.asarray(np.maximum(self.mean_s * (1.0 + self.WANDER * walk), 0.0))


@dataclass(frozen=True)
class _Stutter:
    mean_s: float
    SHAPE = 0.8
    MEAN_OF_SHAPE = 1.133
    """Of Weibull's distribution with scale 1: Γ(1 + 1/0.8)."""

    def __call__(self, n_commands: int, rng: np.random.Generator) -> Array:
        """Independent waits."""
        return np.asarray(self.mean_s / self.MEAN_OF_SHAPE * rng.weibull(self.SHAPE, n_commands))


@dataclass(frozen=True)
class _Bursts:
    share: float
    LEAVE = 0.7
    """Chance that a burst ends with each command."""

    def __call__(self, n_commands: int, rng: np.random.Generator) -> Array:
        """Infinity where a command is lost."""
        enter = self.share * self.LEAVE / (1.0 - self.share)
        draws = rng.random(n_commands).tolist()
        lost = np.zeros(n_commands, dtype=np.bool_)
        bad = False
        for i, draw in enumerate(draws):
            bad = draw >= self.LEAVE if bad else draw < enter
            lost[i] = bad
        return np.where(lost, np.inf, 0.0)


OFFSET_RAD = 0.05
NOISE = (1.5e-3, 0.15, 1.8)
TILT_RAD = 0.052
LAG_S = 0.045


def encoder_offset(robot: Robot, ask: Ask) -> Parameters:
    """A zero that is off, on a ring that sits a little off centre."""
    offset = sign(ask.rng) * ask.size * OFFSET_RAD
    phase = float(ask.rng.uniform(-np.pi, np.pi))

    s = robot.sensing
    s.offset_rad = s.offset_rad + at(ask.joints, offset)
    s.eccentricity_rad = s.eccentricity_rad + at(ask.joints, 0.04 * abs(offset))
    s.eccentricity_phase_rad = np.where(ask.joints, phase, s.eccentricity_phase_rad)
    return {"encoder_offset.offset_rad": offset}


def noise(robot: Robot, ask: Ask) -> Parameters:
    """Bad shielding: all three sensors of a joint are noisy."""
    more = [ask.size * level for level in NOISE]
    names = ("position_rad", "velocity_rad_s", "load_nm")
    fields = ("position_noise_rad", "velocity_noise_rad_s", "load_noise_nm")

    for field, level in zip(fields, more, strict=True):
        now = getattr(robot.sensing, field)
        setattr(robot.sensing, field, np.hypot(now, at(ask.joints, level)))
    return {f"sensor_noise.{n}": level for n, level in zip(names, more, strict=True)}


def crooked_imu(robot: Robot, ask: Ask) -> Parameters:
    """A unit that was mounted askew: all that it feels is turned."""
    towards = float(ask.rng.uniform(-np.pi, np.pi))
    tilt = ask.size * TILT_RAD
    roll, pitch = tilt * np.cos(towards), tilt * np.sin(towards)

    robot.sensing.imu_tilt_rpy_rad = robot.sensing.imu_tilt_rpy_rad + np.array([roll, pitch, 0.0])
    return {"imu_tilt.roll_rad": float(roll), "imu_tilt.pitch_rad": float(pitch)}


def lazy(robot: Robot, ask: Ask) -> Parameters:
    """A low pass on the velocity that is handed out."""
    lag = ask.size * LAG_S

    robot.estimator.output_lag_s = float(np.hypot(robot.estimator.output_lag_s, lag))
    return {"velocity_estimate.lag_s": lag}


KINDS: Final = (
    FaultKind("slow_queue", "transport", ("command_delay",), BODY, delay),
    FaultKind("stuttering_link", "transport", ("command_jitter",), BODY, jitter),
    FaultKind("lossy_link", "transport", ("command_drop",), BODY, losses),
    FaultKind("encoder_offset", "sensing", ("encoder_offset",), ("joint",), encoder_offset),
    FaultKind("noisy_sensors", "sensing", ("sensor_noise",), JOINT_PLACES, noise),
    FaultKind("crooked_imu", "sensing", ("imu_tilt",), BODY, crooked_imu),
    FaultKind("lazy_estimator", "estimator", ("velocity_estimate",), BODY, lazy),
)
