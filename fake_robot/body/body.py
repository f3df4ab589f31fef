"""The simulated body: one MuJoCo simulation with the hidden truth's effects, stepped between two state messages."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from fake_robot.body.body_model import build_model
from fake_robot.body.drive import Drive
from fake_robot.scenario.scenario import Scenario
from spot_model.effects.base import BodyEstimate, EstimateEffect, JointReading, Motion, SensorEffect, TorqueEffect
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.effect_chains import EstimateChain, OutsideChain, SensorChain, of_kind
from spot_model.plant.model_fields import FIRST_JOINT_DOF
from spot_model.robot import facts
from spot_model.robot.facts import N_JOINTS, N_LEGS, Array
from spot_model.robot.rotation import rotate_inverse_wxyz
from spot_model.robot.terrain import BEYOND_GEOM, GROUND_GEOM

_FOOT_SENSOR_SIZE = 4
_TORQUE_AXIS = np.tile([0, 1, 1], N_LEGS)
_SETTLE_S = 1.2
_START_HEIGHT_M = 0.2
_ABSURD_SPEED_SQUARED = 1e8


SIT_POSITION_RAD = np.array([v for leg in facts.LEG_NAMES for v in (0.3 * facts.side_sign(leg), 2.2, -2.76)])
"""Legs folded, feet beside and behind the hips, shape (12,); the body lies, or nearly so."""


class Body:
    """One body. Arrays are live views of the simulation: copy what has to last."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        self.model = build_model(scenario)
        self._data = mujoco.MjData(self.model)
        self._rng = rng
        self._dt_s = scenario.physics.timestep_s
        self._drag = scenario.physics.unpowered_damping_nm_s_per_rad
        self._is_flat = scenario.terrain.kind == "flat"
        self._ground = int(self.model.geom(GROUND_GEOM).id)
        self._beyond_m = 0.0 if self._is_flat else float(self.model.geom(BEYOND_GEOM).pos[2])
        data = self._data
        self.base_position_m: Array = data.qpos[:3]
        self.base_wxyz: Array = data.qpos[3:7]
        self.joint_position_rad: Array = data.qpos[7:]
        self._velocity: Array = data.qvel
        self.base_velocity: Array = data.qvel[:6]
        """Linear in the world, then angular in the body; shape (6,)."""
        self.joint_velocity_rad_s: Array = data.qvel[FIRST_JOINT_DOF:]
        self.motor_torque_nm: Array = data.ctrl
        n_foot = _FOOT_SENSOR_SIZE * N_LEGS
        self._feet: Array = data.sensordata[:n_foot].reshape(N_LEGS, _FOOT_SENSOR_SIZE)
        self._sensors: Array = data.sensordata
        self.specific_force_m_s2: Array = data.sensordata[-3:]
        """What an accelerometer felt in the last physics step, body axes, shape (3,)."""
        self._torque_index = n_foot + 3 * np.arange(N_JOINTS) + _TORQUE_AXIS
        self._row_position: Array = self.joint_position_rad[np.newaxis]
        self._row_velocity: Array = self.joint_velocity_rad_s[np.newaxis]
        effects = [e for e in scenario.robot_model.effects if not e.is_null]
        self._drive = Drive(of_kind(effects, TorqueEffect))
        self._outside = OutsideChain(
            effects,
            self.model,
            lambda name: getattr(data, name)[np.newaxis],
            lambda: self.model.opt.gravity[np.newaxis],
        )
        sensors, estimators = of_kind(effects, SensorEffect), of_kind(effects, EstimateEffect)
        self.has_sensors = bool(sensors)
        self.has_estimators = bool(estimators) or self._outside.odom_from_ground_wxyz() is not None
        """Whether anything changes what the joints, or the body's estimator, report."""
        self.torque_gain: Array | None = None
        """A fault of the drives: motor torque is multiplied by this, shape (12,)."""
        self._sit_down()
        reading = self._true_reading()
        self._sensor_chain = SensorChain(sensors, reading.position_rad, reading)
        self._estimate_chain = EstimateChain(estimators, reading.position_rad, self._true_estimate())
        self._reading: JointReading | None = None
        self._still = self._state()

    # Moving -----------------------------------------------------------------------------------------------------------

    def step(self, servo: ServoCommand | None) -> None:
        """One physics step under these servos; None for motors without power."""
        if servo is None:
            self.motor_torque_nm[:] = -self._drag * self.joint_velocity_rad_s
        else:
            # Fresh arrays: an effect may keep what it is shown until the next step.
            motion = Motion(self._row_position.copy(), self._row_velocity.copy(), self._dt_s)
            torque = self._drive.torque_nm(servo, motion, self._reading or motion)[0]
            self.motor_torque_nm[:] = torque if self.torque_gain is None else torque * self.torque_gain
        self._outside.act(self._data.time)
        mujoco.mj_step(self.model, self._data)
        if self.has_sensors:
            self._reading = self._sensor_chain.read(self._true_reading(), self._dt_s, self._rng)

    def push(self, linear_velocity_m_s: Array, angular_velocity_rad_s: Array) -> None:
        """Add to the body's velocity at once: linear in the world, angular in the body."""
        self.base_velocity[:3] += linear_velocity_m_s
        self.base_velocity[3:] += angular_velocity_rad_s

    def set_external_torque_in_body(self, torque_nm: Array) -> None:
        """A torque on the body that nobody's motors give, shape (3,), body axes, N·m, until it is changed."""
        in_world = np.empty(3)
        mujoco.mju_rotVecQuat(in_world, torque_nm, self.base_wxyz)
        self._data.xfrc_applied[self.model.body("body").id, 3:] = in_world

    def has_diverged(self) -> bool:
        """Whether the simulation holds a number that is not finite, or absurd."""
        velocity = self._velocity
        return not float(velocity @ velocity) < _ABSURD_SPEED_SQUARED

    def recover(self) -> None:
        """Put the body where it lay at the start: the way on after a divergence."""
        mujoco.mj_setState(self.model, self._data, self._still, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(self.model, self._data)
        self._drive.reset()
        self._reading = None

    # Seen from outside ------------------------------------------------------------------------------------------------

    def reading(self) -> JointReading:
        """What the joints' sensors report, before the scenario's noise; arrays of shape (1, 12)."""
        return self._reading or self._true_reading()

    def estimate(self, dt_s: float) -> BodyEstimate:
        """What the estimator reports, before the scenario's noise, ``dt_s`` after the last time; first axis 1."""
        truth = self._true_estimate()
        return self._estimate_chain.estimate(truth, self.reading(), dt_s, self._rng) if self.has_estimators else truth

    def link_torque_nm(self) -> Array:
        """Torque between gearbox and link, shape (12,)."""
        torque: Array = self._sensors.take(self._torque_index)
        return torque

    @property
    def foot_force_n(self) -> Array:
        """Normal force of the ground on each foot, shape (4,)."""
        return np.abs(self._feet[:, 3])

    def height_m(self) -> float:
        """Height of the body's origin over the ground beneath it."""
        height = float(self.base_position_m[2])
        if self._is_flat:
            return height
        down = np.array([0.0, 0.0, -1.0])
        above = self.base_position_m + np.array([0.0, 0.0, 5.0])
        distance = float(mujoco.mj_rayHfield(self.model, self._data, self._ground, above, down))
        return distance - 5.0 if distance >= 0.0 else height - self._beyond_m

    def tilt_rad(self) -> float:
        """Angle between the body's z axis and the vertical."""
        _, x, y, _ = self.base_wxyz.tolist()
        return math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0))

    def is_lying(self) -> bool:
        """Whether the body itself touches the ground."""
        body = int(self.model.geom("body").id)
        contacts: NDArray[np.int32] = self._data.contact.geom
        return bool((contacts == body).any())

    # Private ----------------------------------------------------------------------------------------------------------

    def _sit_down(self) -> None:
        """Start on the ground, legs folded, without power, at rest."""
        self.base_position_m[:] = (0.0, 0.0, _START_HEIGHT_M)
        self.joint_position_rad[:] = SIT_POSITION_RAD
        self._drive.reset()
        for _ in range(round(_SETTLE_S / self._dt_s)):
            self.motor_torque_nm[:] = -self._drag * self.joint_velocity_rad_s
            mujoco.mj_step(self.model, self._data)

    def _state(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_INTEGRATION))
        mujoco.mj_getState(self.model, self._data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state

    def _true_reading(self) -> JointReading:
        return JointReading(self._row_position.copy(), self._row_velocity.copy(), self.link_torque_nm()[np.newaxis])

    def _true_estimate(self) -> BodyEstimate:
        attitude = self.base_wxyz[np.newaxis].copy()
        return BodyEstimate(
            linear_vel_of_body_in_body_m_s=rotate_inverse_wxyz(attitude, self.base_velocity[np.newaxis, :3]),
            angular_vel_of_body_in_body_rad_s=self.base_velocity[np.newaxis, 3:].copy(),
            world_from_body_wxyz=self._outside.in_odom(attitude),
            foot_contact=(self._feet[np.newaxis, :, 0] > 0.0).astype(np.float64),
        )
