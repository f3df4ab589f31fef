"""The robot's state estimator: a filter over gyroscope, accelerometer and legs that stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import matrix_from_wxyz, multiply_wxyz
from withheld.simulator.parameters import GRAVITY_M_S2, EstimatorParameters

_HIP_X_M = np.array([facts.end_sign(leg) * facts.HX_FROM_BODY_M[0] for leg in facts.LEG_NAMES])
_HIP_Y_M = np.array([facts.side_sign(leg) * facts.HX_FROM_BODY_M[1] for leg in facts.LEG_NAMES])
_OUT_M = np.array([facts.side_sign(leg) * facts.HY_FROM_HX_M[1] for leg in facts.LEG_NAMES])
_THIGH_X_M, _, _THIGH_Z_M = facts.KN_FROM_HY_M
_SHANK_M = facts.FOOT_FROM_KN_M[2]
SETTLED_STATES = 9
"""A foot counts as standing so long after its flag: the leg still swings from the impact."""
FULL_FORCE_N = 90.0
"""A foot that carries less counts for less: it is about to lift off."""
DOUBTFUL_M_S = 0.06
"""A foot that moves so fast against the prediction counts by half."""


class Estimator:
    """Attitude, velocity and position in odom, of n runs.

    The gyroscope turns the attitude; gravity, felt on average, sets it upright. The accelerometer moves the velocity;
    standing feet, which roll on their radius, pull it back.
    """

    def __init__(self, parameters: EstimatorParameters, attitude_wxyz: Array, position_m: Array, dt_s: float) -> None:
        self._p, self._dt_s = parameters, dt_s
        n = len(attitude_wxyz)
        self.attitude_wxyz: Array = attitude_wxyz.copy()
        self._rotation: Array = matrix_from_wxyz(attitude_wxyz)
        self.position_m: Array = position_m.copy()
        self.velocity_m_s: Array = np.zeros((n, 3))
        self._filtered: Array = np.zeros((n, 3))
        lag = parameters.output_lag_s
        self._keep = float(np.exp(-dt_s / lag)) if lag > 0.0 else 0.0
        self.turn_rad_s: Array = np.zeros((n, 3))

    @property
    def reported_velocity_m_s(self) -> Array:
        """In odom, shape (n, 3)."""
        return self._filtered

    def step(
        self,
        turn_rad_s: Array,
        acceleration_m_s2: Array,
        position_rad: Array,
        velocity_rad_s: Array,
        contact_age: Array,
        foot_force_n: Array,
    ) -> None:
        """Take in one state's readings.

        Args:
            turn_rad_s: Gyroscope, unit's frame, (n, 3).
            acceleration_m_s2: Specific force, mean since the last state, (n, 3).
            position_rad: Joints as read, (n, 12).
            velocity_rad_s: Joints as read, (n, 12).
            contact_age: States since each foot was said to stand, (n, 4).
            foot_force_n: As the contact detector has it, (n, 4).
        """
        p, dt = self._p, self._dt_s
        up = self._rotation[:, 2, :]
        lean = _cross(acceleration_m_s2, up) / GRAVITY_M_S2
        turn = (turn_rad_s + p.tilt_rate_per_s * lean) * (0.5 * dt)
        attitude = multiply_wxyz(self.attitude_wxyz, np.concatenate([np.ones((len(turn), 1)), turn], axis=1))
        self.attitude_wxyz = attitude / np.sqrt(np.sum(attitude * attitude, axis=1, keepdims=True))
        rotation = self._rotation = matrix_from_wxyz(self.attitude_wxyz)
        felt = _turned(rotation, acceleration_m_s2)
        felt[:, 2] -= GRAVITY_M_S2
        predicted = self.velocity_m_s + dt * felt
        by_leg = self._by_legs(rotation, turn_rad_s, position_rad, velocity_rad_s)
        off = by_leg - predicted[:, None, :]
        # A foot that disagrees with the prediction is lifting off or sliding, and counts the less for it.
        square = np.sum(off * off, axis=2)
        trust = (contact_age > SETTLED_STATES) * np.minimum(foot_force_n / FULL_FORCE_N, 1.0)
        trust = trust / (1.0 + square / DOUBTFUL_M_S**2)
        count = np.maximum(np.sum(trust, axis=1, keepdims=True), 0.1)
        mean_off = np.sum(off * trust[:, :, None], axis=1) / count
        self.velocity_m_s = predicted + (dt / p.odometry_time_s) * mean_off
        self.position_m = self.position_m + dt * self.velocity_m_s
        self._filtered = self.velocity_m_s + self._keep * (self._filtered - self.velocity_m_s)
        self.turn_rad_s = _turned(rotation, turn_rad_s)

    def _by_legs(self, rotation: Array, turn: Array, position: Array, velocity: Array) -> Array:
        """The body's velocity in odom by each leg, if its foot rolls on the ground; shape (n, 4, 3)."""
        hx, hy = position[:, 0::3], position[:, 1::3]
        hx_rate, thigh_rate = velocity[:, 0::3], velocity[:, 1::3]
        shank_rate = thigh_rate + velocity[:, 2::3]
        angles = np.stack([hx, hy, hy + position[:, 2::3]])
        (sin_hx, sin_thigh, sin_shank), (cos_hx, cos_thigh, cos_shank) = np.sin(angles), np.cos(angles)
        # In the leg's plane, x forward and z along the leg's own up.
        thigh_x, thigh_z = (
            _THIGH_X_M * cos_thigh + _THIGH_Z_M * sin_thigh,
            _THIGH_Z_M * cos_thigh - _THIGH_X_M * sin_thigh,
        )
        shank_x, shank_z = _SHANK_M * sin_shank, _SHANK_M * cos_shank
        plane_z = thigh_z + shank_z
        plane_z_rate = -thigh_x * thigh_rate - shank_x * shank_rate
        y, z = _OUT_M * cos_hx - plane_z * sin_hx, _OUT_M * sin_hx + plane_z * cos_hx
        foot = np.stack([_HIP_X_M + thigh_x + shank_x, _HIP_Y_M + y, z], axis=2)
        rate = np.stack(
            [
                thigh_z * thigh_rate + shank_z * shank_rate,
                -z * hx_rate - plane_z_rate * sin_hx,
                y * hx_rate + plane_z_rate * cos_hx,
            ],
            axis=2,
        )
        moved = _cross(turn[:, None, :], foot) + rate
        shank = np.stack([hx_rate, shank_rate * cos_hx, shank_rate * sin_hx], axis=2)
        up = facts.FOOT_RADIUS_M * rotation[:, 2, :][:, None, :]
        rolled = _cross(turn[:, None, :] + shank, up)
        in_body = self._p.odometry_scale * (rolled - moved)
        in_body[:, :, :2] += self._p.odometry_bias_m_s
        return np.asarray(np.matmul(in_body, rotation.transpose(0, 2, 1)))


def _turned(rotation: Array, vector: Array) -> NDArray[np.float64]:
    """Vectors (n, 3) from the body's frame into odom's."""
    return np.asarray(np.matmul(rotation, vector[:, :, None])[:, :, 0])


def _cross(a: Array, b: Array) -> Array:
    """Cross product along the last axis; NumPy's own takes four times as long for arrays this small."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = ay * bz - az * by
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx
    return out
