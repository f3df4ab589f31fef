"""Sensors that are off, and a state estimator that is tuned to be lazy."""

from __future__ import annotations

import numpy as np

from withheld.realities.fault_kind import Ask, Parameters, at, sign
from withheld.simulator.robot import Robot

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
