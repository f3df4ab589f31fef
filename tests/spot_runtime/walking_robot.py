"""A robot that walks by formulas alone: all of its signals fit together, with the noise of ordinary sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import ImuPacket, RobotState
from spot_runtime.control.safety.signals.legs import feet
from tests.spot_runtime.conftest import STAND_LOAD_NM, START_NS

STRIDE_HZ = 2.0
SWING_RAD = 0.25
HEADING_RAD = 1.2
"""It walks neither north nor east, so that a frame taken for another shows."""


@dataclass
class WalkingRobot:
    """A trot: diagonal legs swing together; the body moves as the standing feet let it, rolls a little, and turns."""

    is_walking: bool = True
    turn_rate_rad_s: float = 0.4
    noise: float = 1.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))

    def state(self, index: int, key: int = 0) -> RobotState:
        """The state so many periods after the start."""
        t, stamp_ns = index * 0.003, START_NS + index * facts.STATE_PERIOD_NS
        walk = partial(_motion, turn_rate_rad_s=self.turn_rate_rad_s, is_walking=self.is_walking)
        motion = walk(t)
        rotation = _matrix(motion.attitude)
        gained = (walk(t + 5e-4).linear - walk(t - 5e-4).linear) / 1e-3
        n = self.noise * self.rng.standard_normal(64)
        packets = tuple(
            ImuPacket(
                stamp_ns,
                rotation.T @ (gained + np.array([0.0, 0.0, 9.81])) + 0.15 * n[45:48],
                rotation.T @ motion.turn_rate + 0.008 * n[48:51],
                -motion.attitude,
            )
            for _ in range(3)
        )
        return RobotState(
            robot_stamp_ns=stamp_ns,
            host_stamp_ns=stamp_ns,
            position_rad=motion.position + 3e-4 * n[:12],
            velocity_rad_s=motion.velocity + 0.03 * n[12:24],
            load_nm=STAND_LOAD_NM + 0.4 * n[24:36],
            position_of_body_in_odom_m=np.zeros(3),
            odom_from_body_wxyz=_product(motion.attitude, _about(1, 0.001 * float(n[36]))),
            linear_vel_of_body_in_odom_m_s=motion.linear + 0.015 * n[37:40],
            angular_vel_of_body_in_odom_rad_s=motion.turn_rate + 0.01 * n[40:43],
            foot_contact=motion.contact,
            last_command_key=key,
            last_command_robot_stamp_ns=stamp_ns,
            imu=packets,
        )


class _Motion(NamedTuple):
    position: np.ndarray
    velocity: np.ndarray
    attitude: np.ndarray
    linear: np.ndarray
    turn_rate: np.ndarray
    contact: np.ndarray


@lru_cache(maxsize=20_000)
def _motion(t: float, *, turn_rate_rad_s: float, is_walking: bool) -> _Motion:
    """What it does at a time, s; every test asks for the same few."""
    rate = 2.0 * np.pi * STRIDE_HZ
    walks = 1.0 if is_walking else 0.0
    phases = rate * t + np.array([0.0, np.pi, np.pi, 0.0])
    position, velocity = facts.DEFAULT_POSITION_RAD.copy(), np.zeros(12)
    for joint, swing_rad in enumerate((0.05, SWING_RAD, 0.06)):
        position[joint::3] += walks * swing_rad * np.sin(phases)
        velocity[joint::3] = walks * swing_rad * rate * np.cos(phases)
    # A leg that swings backwards stands.
    contact = np.cos(phases) > 0.0 if is_walking else np.ones(4, dtype=np.bool_)
    heading = HEADING_RAD + walks * turn_rate_rad_s * t
    attitude = _product(_about(2, heading), _about(0, walks * 0.04 * np.sin(rate * t)))
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    turn_rate = walks * (0.04 * rate * np.cos(rate * t) * ahead + np.array([0.0, 0.0, turn_rate_rad_s]))
    rotation = _matrix(attitude)
    legs, in_body = feet(position, velocity), rotation.T @ turn_rate
    relative = legs.velocity_m_s + np.cross(in_body, legs.position_m)
    relative -= facts.FOOT_RADIUS_M * np.cross(in_body + legs.turn_rate_rad_s, rotation[2])
    linear = rotation @ -relative[contact].mean(axis=0) if is_walking and contact.any() else np.zeros(3)
    return _Motion(position, velocity, attitude, linear, turn_rate, contact)


def _about(axis: int, angle_rad: float) -> np.ndarray:
    quaternion = np.array([np.cos(0.5 * angle_rad), 0.0, 0.0, 0.0])
    quaternion[1 + axis] = np.sin(0.5 * angle_rad)
    return quaternion


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    scalar = a[0] * b[0] - a[1:] @ b[1:]
    return np.concatenate([[scalar], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def _matrix(q: np.ndarray) -> np.ndarray:
    cross = np.array([[0.0, -q[3], q[2]], [q[3], 0.0, -q[1]], [-q[2], q[1], 0.0]])
    return np.eye(3) + 2.0 * q[0] * cross + 2.0 * cross @ cross
