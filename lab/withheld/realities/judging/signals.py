"""The link and the sending program; sensors and the state estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import STATE_PERIOD_NS, Array
from withheld.realities.fault_kind import BODY, JOINT_PLACES, LEG_PLACES, Ask, FaultKind, Parameters, at, sign
from withheld.simulator.robot import Robot, leg_mask

DELAY_S: Final = 0.012
JITTER_S: Final = 0.004
TAIL: Final = 0.9
"""Standard deviation of the logarithm of a wait."""
LOSS: Final = 0.06
BEAT_S, BEAT_SHARE = 0.7, 0.15
SCALE, POSE_RAD, SWAP = 0.25, 0.08, 0.4


def late(robot: Robot, ask: Ask) -> Parameters:
    """A fixed delay with the sawtooth of two clocks that drift past each other."""
    mean = ask.size * DELAY_S

    def draw(n: int, rng: np.random.Generator) -> Array:
        turns = np.arange(n) * STATE_PERIOD_NS * 1e-9 / BEAT_S + rng.random()
        return np.asarray(mean * (1.0 + BEAT_SHARE * (2.0 * (turns % 1.0) - 1.0)))

    robot.delays.append(draw)
    return {"command_delay.delay_s": mean}


def uneven(robot: Robot, ask: Ask) -> Parameters:
    """Log-normal waits."""
    mean = ask.size * JITTER_S

    def draw(n: int, rng: np.random.Generator) -> Array:
        return np.asarray(mean * np.exp(TAIL * rng.standard_normal(n) - 0.5 * TAIL**2))

    robot.delays.append(draw)
    return {"command_jitter.mean_s": mean}


def lost(robot: Robot, ask: Ask) -> Parameters:
    """Commands that are lost one by one."""
    share = ask.size * LOSS
    robot.delays.append(lambda n, rng: np.where(rng.random(n) < share, np.inf, 0.0))
    return {"command_drop.probability": share}


@dataclass(frozen=True)
class Program:
    """Set-points as scale, offset and a share of the other side's."""

    scale: Array
    offset: Array
    share: Array

    def __call__(self, setpoint_rad: Array) -> Array:
        """What the program sends."""
        about = facts.DEFAULT_POSITION_RAD
        sent = about + self.scale * (setpoint_rad - about) + self.offset
        legs = sent.reshape(len(sent), facts.N_LEGS, 3)
        return np.asarray(sent + self.share * (legs[:, [1, 0, 3, 2]].reshape(sent.shape) - sent))


def scaled(robot: Robot, ask: Ask) -> Parameters:
    """Another action scale than the policy's."""
    change = sign(ask.rng) * ask.size * SCALE
    part = Program(1.0 + at(ask.joints, change), np.zeros(12), np.zeros(12))
    robot.setpoints.append(part)
    return {"action_scale.scale": 1.0 + change}


def shifted(robot: Robot, ask: Ask) -> Parameters:
    """Another default pose than the policy's."""
    offset = sign(ask.rng) * ask.size * POSE_RAD
    part = Program(np.ones(12), at(ask.joints, offset), np.zeros(12))
    robot.setpoints.append(part)
    return {"default_pose.offset_rad": offset}


def swapped(robot: Robot, ask: Ask) -> Parameters:
    """Left and right are mixed, as by a wrong matrix."""
    share = ask.size * SWAP
    part = Program(np.ones(12), np.zeros(12), at(ask.joints, share))
    robot.setpoints.append(part)
    return {"joint_swap.share": share}


ZERO_RAD: Final = 0.05
CELL_GAIN, CELL_BIAS_NM = 0.15, 1.0
NOISE: Final = np.array([1.5e-3, 0.15, 1.8])
"""Of position (rad), velocity (rad/s) and load (N·m) at size 1."""
COLOUR: Final = 0.4
"""Correlation of the noise from one state to the next."""
MOST_STATES: Final = 8
FLAG_S: Final = 0.04
TILT_RAD: Final = 0.052
LENGTHS, SLIP_M_S, LAG_S = 0.12, 0.06, 0.045


def zero(robot: Robot, ask: Ask) -> Parameters:
    """An encoder's zero that is off."""
    offset = sign(ask.rng) * ask.size * ZERO_RAD

    robot.sensing.offset_rad = robot.sensing.offset_rad + at(ask.joints, offset)
    return {"encoder_offset.offset_rad": offset}


def cell(robot: Robot, ask: Ask) -> Parameters:
    """A load cell with a wrong scale and a zero that has crept."""
    gain, bias = 1.0 + sign(ask.rng) * ask.size * CELL_GAIN, sign(ask.rng) * ask.size * CELL_BIAS_NM

    s = robot.sensing
    s.load_gain = np.where(ask.joints, s.load_gain * gain, s.load_gain)
    s.load_bias_nm = s.load_bias_nm + at(ask.joints, bias)
    return {"load_sensor_gain.gain": gain, "load_sensor_gain.bias_nm": bias}


class ColouredNoise:
    """Noise that remembers a little of the state before; from its own generators, so that it changes no other draw."""

    def __init__(self, sigma: Array, seed: int) -> None:
        self._sigma, self._seed = sigma, seed
        self._rngs: list[np.random.Generator] = []
        self._now: Array = np.zeros((1, len(sigma)))

    def start(self, n_runs: int) -> None:
        """Silent."""
        self._rngs = [np.random.default_rng([self._seed, run]) for run in range(n_runs)]
        self._now = np.zeros((n_runs, len(self._sigma)))

    def act(self, reading: Array, dt_s: float) -> Array:
        """With the noise."""
        fresh = np.stack([rng.standard_normal(len(self._sigma)) for rng in self._rngs])
        self._now = COLOUR * self._now + np.sqrt(1.0 - COLOUR**2) * fresh
        return np.asarray(reading + self._sigma * self._now)


def noise(robot: Robot, ask: Ask) -> Parameters:
    """Bad shielding: all three sensors of a joint are noisy."""
    more = ask.size * NOISE
    part = ColouredNoise(np.concatenate([at(ask.joints, v) for v in more]), int(ask.rng.integers(2**31)))
    names = ("position_rad", "velocity_rad_s", "load_nm")
    robot.readings.append(part)
    return {f"sensor_noise.{n}": float(v) for n, v in zip(names, more, strict=True)}


class MovingAverage:
    """Velocities averaged over the last n states; delays by (n − 1)/2 of them."""

    def __init__(self, joints: np.ndarray, n_states: int) -> None:
        self._joints, self._n = joints, n_states
        self._past: list[Array] = []

    def start(self, n_runs: int) -> None:
        """Nothing was read yet."""
        self._past = []

    def act(self, reading: Array, dt_s: float) -> Array:
        """With averaged velocities."""
        self._past = [*self._past[1 - self._n :], reading[:, 12:24].copy()] if self._n > 1 else [reading[:, 12:24]]
        out = reading.copy()
        out[:, 12:24] = np.where(self._joints, np.mean(self._past, axis=0), reading[:, 12:24])
        return out


def average(robot: Robot, ask: Ask) -> Parameters:
    """Reported rates are moving averages."""
    n_states = 2 + round(ask.size * (MOST_STATES - 2))
    delay_s = 0.5 * (n_states - 1) * STATE_PERIOD_NS * 1e-9
    robot.readings.append(MovingAverage(ask.joints, n_states))
    return {"velocity_filter.time_constant_s": delay_s}


def flags(robot: Robot, ask: Ask) -> Parameters:
    """A contact detector that waits to be sure."""
    delay_s = ask.size * FLAG_S

    s = robot.sensing
    more = np.where(leg_mask(ask.joints), delay_s / (STATE_PERIOD_NS * 1e-9), 0.0)
    s.contact_hold_states = s.contact_hold_states + more
    return {"contact_delay.delay_s": delay_s}


def tilted(robot: Robot, ask: Ask) -> Parameters:
    """An inertial unit that was mounted askew."""
    towards, tilt = float(ask.rng.uniform(-np.pi, np.pi)), ask.size * TILT_RAD
    roll, pitch = tilt * np.cos(towards), tilt * np.sin(towards)

    robot.sensing.imu_tilt_rpy_rad = robot.sensing.imu_tilt_rpy_rad + np.array([roll, pitch, 0.0])
    return {"imu_tilt.roll_rad": float(roll), "imu_tilt.pitch_rad": float(pitch)}


def lengths(robot: Robot, ask: Ask) -> Parameters:
    """Legs of another length in the estimator's own model, and a constant slip."""
    scale = 1.0 + sign(ask.rng) * ask.size * LENGTHS
    slip = ask.size * SLIP_M_S * ask.rng.uniform(-1.0, 1.0, 2)

    robot.estimator.odometry_scale *= scale
    robot.estimator.odometry_bias_m_s = robot.estimator.odometry_bias_m_s + slip
    return {"velocity_estimate.scale": scale}


def sluggish(robot: Robot, ask: Ask) -> Parameters:
    """A low pass on the velocity that is handed out."""
    lag = ask.size * LAG_S

    robot.estimator.output_lag_s += lag
    return {"velocity_estimate.lag_s": lag}


KINDS: Final = (
    FaultKind("drifting_clocks", "transport", ("command_delay",), BODY, late),
    FaultKind("uneven_waits", "transport", ("command_jitter",), BODY, uneven),
    FaultKind("lost_commands", "transport", ("command_drop",), BODY, lost),
    FaultKind("other_action_scale", "software", ("action_scale",), ("type", "all"), scaled),
    FaultKind("other_pose", "software", ("default_pose",), ("joint", "type"), shifted),
    FaultKind("mixed_sides", "software", ("joint_swap",), ("type",), swapped),
    FaultKind("moved_zero", "sensing", ("encoder_offset",), ("joint",), zero),
    FaultKind("crept_load_cell", "sensing", ("load_sensor_gain",), ("joint", "type", "leg"), cell),
    FaultKind("bad_shielding", "sensing", ("sensor_noise",), JOINT_PLACES, noise),
    FaultKind("averaged_rates", "sensing", ("velocity_filter",), ("type", "leg", "all"), average),
    FaultKind("waiting_flags", "sensing", ("contact_delay",), LEG_PLACES, flags),
    FaultKind("askew_unit", "sensing", ("imu_tilt",), BODY, tilted),
    FaultKind("wrong_leg_lengths", "estimator", ("velocity_estimate",), BODY, lengths),
    FaultKind("sluggish_estimate", "estimator", ("velocity_estimate",), BODY, sluggish),
)
