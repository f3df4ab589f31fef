"""What the robot reports: the body's truth, seen through sensors and an estimator, with noise, in odometry frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from fake_robot.body.body import Body
from fake_robot.body.fault_effects import FaultEffects
from fake_robot.scenario.scenario import Scenario
from spot_model.robot.facts import N_JOINTS, STATE_PERIOD_NS, Array

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Frame:
    """A frame that is shifted, and turned about the vertical, from the world."""

    def __init__(self, position_in_world_m: Vector, yaw_rad: float) -> None:
        self._x, self._y, self._z = position_in_world_m
        self._cos, self._sin = math.cos(yaw_rad), math.sin(yaw_rad)
        # The frame's quaternion in the world is (w, 0, 0, -z); this is its inverse.
        self._qw, self._qz = math.cos(0.5 * yaw_rad), -math.sin(0.5 * yaw_rad)

    def point(self, in_world_m: Sequence[float]) -> Vector:
        """A point of the world in this frame."""
        x, y, z = in_world_m
        return self.vector((x - self._x, y - self._y, z - self._z))

    def vector(self, in_world: Sequence[float]) -> Vector:
        """A vector of the world in this frame."""
        x, y, z = in_world
        cos, sin = self._cos, self._sin
        return cos * x + sin * y, cos * y - sin * x, z

    def rotation(self, world_from_body_wxyz: Sequence[float]) -> Quaternion:
        """The body's attitude in this frame, scalar first."""
        w, x, y, z = world_from_body_wxyz
        a, b = self._qw, self._qz
        return a * w - b * z, a * x - b * y, a * y + b * x, a * z + b * w


IMU_PACKETS = 3
IMU_PERIOD_NS = 1_000_000
_JOINTS, _BODY = slice(0, 3 * N_JOINTS), slice(3 * N_JOINTS, 3 * N_JOINTS + 9)
_IMU = slice(3 * N_JOINTS + 9, 3 * N_JOINTS + 9 + 6 * IMU_PACKETS)
_WIDTH = _IMU.stop
_QUATERNIONS = ("world_from_body_wxyz", "imu_wxyz")


class Report(NamedTuple):
    """One state as the robot reports it. Canonical joint order, legs fl fr hl hr, SI units; joints of shape (12,)."""

    elapsed_ns: int
    """Robot time since the start at which it was sampled."""
    position_rad: Array
    velocity_rad_s: Array
    load_nm: Array
    world_from_body_wxyz: Array
    """Estimated orientation. The odometry frames are fixed in the world."""
    position_of_body_in_world_m: Array
    linear_vel_of_body_in_world_m_s: Array
    angular_vel_of_body_in_world_rad_s: Array
    foot_contact: NDArray[np.bool_]
    imu_acceleration_m_s2: Array
    """Specific force in the body frame, one row a packet, oldest first; shape (3, 3)."""
    imu_angular_velocity_rad_s: Array
    imu_wxyz: Array
    """Attitude at each packet, shape (3, 4)."""
    arm: Array = np.empty((3, 0))
    """Positions, velocities and loads of an arm's joints, shape (3, 7); without one, (3, 0)."""


class Sensing:
    """Samples the body at every physics step, and reports once a state message."""

    def __init__(self, scenario: Scenario, body: Body, rng: np.random.Generator) -> None:
        self._body = body
        self._rng = rng
        config = scenario.sensors
        joints = [config.position_rad] * N_JOINTS + [config.velocity_rad_s] * N_JOINTS + [config.load_nm] * N_JOINTS
        base = [config.body_velocity_m_s] * 3 + [config.body_angular_velocity_rad_s] * 3 + [config.attitude_rad] * 3
        imu = ([config.imu_acceleration_m_s2] * 3 + [config.imu_angular_velocity_rad_s] * 3) * IMU_PACKETS
        self._sigma = np.array(joints + base + imu)
        self._noise = np.zeros((0, _WIDTH))
        self._row = 0
        self._threshold_n = config.contact_threshold_n
        self._period_s = STATE_PERIOD_NS * 1e-9
        n = scenario.physics.substeps_per_state
        # Specific force (3), turn rate (3), attitude (4): at the end of the last period, then after each physics step.
        self._samples = np.zeros((n + 1, 10))
        for row in range(n + 1):
            self.sample(row - 1)
        self._imu_weights = imu_weights(n)
        self._joints = np.empty(3 * N_JOINTS)
        self._frozen: Report | None = None

    def sample(self, substep: int) -> None:
        """Note the body's motion after the physics step with this number, from 0, since the last report."""
        row = self._samples[substep + 1]
        row[:3] = self._body.specific_force_m_s2
        row[3:6] = self._body.base_velocity[3:]
        row[6:] = self._body.base_wxyz

    def report(self, elapsed_ns: int, effects: FaultEffects) -> Report:
        """The state now; faults of the sensors included."""
        body, noise = self._body, self._next_noise()
        joints, base = self._read_joints() + noise[_JOINTS], noise[_BODY]
        attitude, linear, angular, contact = self._estimate()
        quaternion = _perturbed(attitude, base[6:])
        packets = self._imu_weights @ self._samples
        packets[:, :6] += noise[_IMU].reshape(IMU_PACKETS, 6)
        report = Report(
            elapsed_ns,
            joints[:N_JOINTS],
            joints[N_JOINTS : 2 * N_JOINTS],
            joints[2 * N_JOINTS :],
            quaternion,
            body.base_position_m.copy(),
            linear + base[:3],
            angular + base[3:6],
            contact,
            packets[:, :3],
            packets[:, 3:6],
            packets[:, 6:],
        )
        self._samples[0] = self._samples[-1]
        if effects.has_sensor_fault:
            return self._faulty(report, effects)
        self._frozen = None
        return report

    # Private ----------------------------------------------------------------------------------------------------------

    def _next_noise(self) -> Array:
        if self._row == len(self._noise):
            self._noise = self._rng.standard_normal((256, _WIDTH)) * self._sigma
            self._row = 0
        row: Array = self._noise[self._row]
        self._row += 1
        return row

    def _read_joints(self) -> Array:
        """Positions, velocities, loads; shape (36,), overwritten by the next call."""
        joints, body = self._joints, self._body
        if body.has_sensors:
            reading = body.reading()
            joints[:] = np.concatenate([reading.position_rad[0], reading.velocity_rad_s[0], reading.load_nm[0]])
        else:
            joints[:N_JOINTS] = body.joint_position_rad
            joints[N_JOINTS : 2 * N_JOINTS] = body.joint_velocity_rad_s
            joints[2 * N_JOINTS :] = body.link_torque_nm()
        return joints

    def _estimate(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Attitude, linear and angular velocity in the world, contacts; with the effects on the estimator."""
        body = self._body
        contact: NDArray[np.bool_] = body.foot_force_n > self._threshold_n
        if not body.has_estimators:
            attitude = body.base_wxyz
            return attitude, body.base_velocity[:3], _rotated(attitude, body.base_velocity[3:]), contact
        estimate = body.estimate(self._period_s)
        attitude = np.ascontiguousarray(estimate.world_from_body_wxyz[0])
        return (
            attitude,
            _rotated(attitude, np.ascontiguousarray(estimate.linear_vel_of_body_in_body_m_s[0])),
            _rotated(attitude, np.ascontiguousarray(estimate.angular_vel_of_body_in_body_rad_s[0])),
            np.asarray(estimate.foot_contact[0] > 0.5),
        )

    def _faulty(self, report: Report, effects: FaultEffects) -> Report:
        if effects.is_frozen:
            self._frozen = self._frozen or report
            report = self._frozen._replace(elapsed_ns=report.elapsed_ns)
        else:
            self._frozen = None
        changes: dict[str, Any] = {}
        if effects.quaternion_scale != 1.0:
            changes = {name: getattr(report, name) * effects.quaternion_scale for name in _QUATERNIONS}
        for name in effects.nan_signals:
            changes[name] = np.full_like(getattr(report, name), np.nan)
        return report._replace(**changes)


def imu_weights(n_steps: int) -> Array:
    """What interpolates samples at 0, 1/n .. 1 of a period at 2, 1 and 0 ms before its end, shape (3, n + 1).

    The specific force is that of a whole physics step, so the packets hold its running mean.
    """
    at = np.linspace(0.0, STATE_PERIOD_NS, n_steps + 1)
    wanted = STATE_PERIOD_NS - IMU_PERIOD_NS * np.arange(IMU_PACKETS - 1, -1, -1)
    return np.stack([np.interp(wanted, at, unit) for unit in np.eye(n_steps + 1)], axis=1)


def _rotated(quaternion_wxyz: Array, vector: Array) -> Array:
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion_wxyz)
    return out


def _perturbed(quaternion_wxyz: Array, angles_rad: Array) -> Array:
    """The rotation with a further small turn about the body's axes."""
    w, x, y, z = quaternion_wxyz.tolist()
    a, b, c = (0.5 * angles_rad).tolist()
    # The product with (1, a, b, c), whose length is the product's; in plain floats, as these are few.
    scale = 1.0 / math.sqrt((1.0 + a * a + b * b + c * c) * (w * w + x * x + y * y + z * z))
    turned = (
        w - x * a - y * b - z * c,
        x + w * a + y * c - z * b,
        y + w * b + z * a - x * c,
        z + w * c + x * b - y * a,
    )
    return scale * np.array(turned)
