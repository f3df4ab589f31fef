"""The state of a batch of simulated robots: joints, body, feet, contacts, torques."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_model.effects.base import BodyEstimate, JointReading
from spot_model.plant.model_fields import FIRST_JOINT_COORDINATE, FIRST_JOINT_DOF
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_and_jacobian, foot_position_in_body_m
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz

_FOOT_SENSOR_SIZE = 4
"""Number of contacts, then the force of the foot on the ground, three components in the world frame."""

_TORQUE_AXIS = np.array([{"hx": 0, "hy": 1, "kn": 1}[name[3:]] for name in facts.JOINT_NAMES])


class PlantState:
    """Arrays of ``n_sims`` simulations; every property is a fresh copy.

    Positions and velocities are those of now. Contacts, forces, torques and accelerations are those that acted in the
    last physics step, which started one step ago; after a reset they are those of the new state without motor torque.
    """

    def __init__(self, batch: Batch, *, has_link_torque: bool) -> None:
        self._batch = batch
        self._has_link_torque = has_link_torque
        self._qpos: Array = batch.bind("qpos")
        self._qvel: Array = batch.bind("qvel")
        self._ctrl: Array = batch.bind("ctrl")
        self._time: Array = batch.bind("time")
        self._ncon: NDArray[np.int32] = batch.bind("ncon")
        sensors: Array = batch.bind("sensordata")
        n_foot = _FOOT_SENSOR_SIZE * facts.N_LEGS
        self._feet = sensors[:, :n_foot].reshape(batch.nsim, facts.N_LEGS, _FOOT_SENSOR_SIZE)
        self._link_torques = sensors[:, n_foot:].reshape(batch.nsim, -1, 3)
        self._joint_pos = self._qpos[:, FIRST_JOINT_COORDINATE:]
        self._joint_vel = self._qvel[:, FIRST_JOINT_DOF:]

    @property
    def n_sims(self) -> int:
        """Number of simulations."""
        return int(self._batch.nsim)

    @property
    def time_s(self) -> Array:
        """Time since each simulation's last reset, shape (n,), s."""
        return self._time.copy()

    # Joints, shape (n, 12), canonical order --------------------------------------------------------------------------

    @property
    def joint_position_rad(self) -> Array:
        """Joint positions, shape (n, 12), rad."""
        position: Array = self._joint_pos.copy()
        return position

    @property
    def joint_velocity_rad_s(self) -> Array:
        """Joint velocities, shape (n, 12), rad/s."""
        velocity: Array = self._joint_vel.copy()
        return velocity

    @property
    def applied_torque_nm(self) -> Array:
        """Motor torque after all torque effects, shape (n, 12), N·m."""
        return self._ctrl.copy()

    @property
    def link_torque_nm(self) -> Array:
        """Torque that a sensor between gearbox and link sees, shape (n, 12), N·m.

        Motor torque less friction, damping and what accelerates the armature; at a joint stop, the stop's torque too.

        Raises:
            ValueError: The model has no such sensors.
        """
        if not self._has_link_torque:
            raise ValueError("this plant has no link-side torque; build it with MjcfOptions(link_torque_sensors=True)")
        torque: Array = self._link_torques[:, np.arange(facts.N_JOINTS), _TORQUE_AXIS]
        return torque

    def true_reading(self) -> JointReading:
        """What perfect sensors of the joints would report; the load is the link's torque where the model has it."""
        load = self.link_torque_nm if self._has_link_torque else self._ctrl.copy()
        return JointReading(self._joint_pos.copy(), self._joint_vel.copy(), load)

    def true_estimate(self) -> BodyEstimate:
        """What a perfect state estimator would report."""
        return BodyEstimate(
            linear_vel_of_body_in_body_m_s=self.linear_vel_of_body_in_body_m_s,
            angular_vel_of_body_in_body_rad_s=self._qvel[:, 3:6].copy(),
            world_from_body_wxyz=self._qpos[:, 3:7].copy(),
            foot_contact=self.foot_contact.astype(np.float64),
        )

    # Body ------------------------------------------------------------------------------------------------------------

    @property
    def position_of_body_in_world_m(self) -> Array:
        """Origin of the body frame, shape (n, 3), m."""
        return self._qpos[:, :3].copy()

    @property
    def world_from_body_wxyz(self) -> Array:
        """Attitude, shape (n, 4), scalar first."""
        return self._qpos[:, 3:7].copy()

    @property
    def linear_vel_of_body_in_world_m_s(self) -> Array:
        """Velocity of the body's origin, shape (n, 3), m/s."""
        return self._qvel[:, :3].copy()

    @property
    def linear_vel_of_body_in_body_m_s(self) -> Array:
        """The same velocity in the body frame, shape (n, 3), m/s."""
        return np.asarray(rotate_inverse_wxyz(self._qpos[:, 3:7], self._qvel[:, :3]))

    @property
    def angular_vel_of_body_in_body_rad_s(self) -> Array:
        """Shape (n, 3), rad/s."""
        return self._qvel[:, 3:6].copy()

    @property
    def angular_vel_of_body_in_world_rad_s(self) -> Array:
        """Shape (n, 3), rad/s."""
        return np.asarray(rotate_wxyz(self._qpos[:, 3:7], self._qvel[:, 3:6]))

    # Feet, legs fl, fr, hl, hr ---------------------------------------------------------------------------------------

    @property
    def foot_position_in_world_m(self) -> Array:
        """Centres of the foot spheres, shape (n, 4, 3), m."""
        in_body = foot_position_in_body_m(self._joint_pos)
        return np.asarray(self._qpos[:, None, :3] + rotate_wxyz(self._qpos[:, None, 3:7], in_body))

    @property
    def foot_velocity_in_world_m_s(self) -> Array:
        """Velocity of the centres of the foot spheres, shape (n, 4, 3), m/s."""
        in_body, jacobian = foot_position_and_jacobian(self._joint_pos)
        rates = self._joint_vel.reshape(self.n_sims, facts.N_LEGS, 1, 3)
        moving = (jacobian * rates).sum(axis=-1) + np.cross(self._qvel[:, None, 3:6], in_body)
        return np.asarray(self._qvel[:, None, :3] + rotate_wxyz(self._qpos[:, None, 3:7], moving))

    @property
    def foot_contact(self) -> NDArray[np.bool_]:
        """Whether each foot touches the ground, shape (n, 4)."""
        contact: NDArray[np.bool_] = self._feet[:, :, 0] > 0.0
        return contact

    @property
    def foot_force_in_world_n(self) -> Array:
        """Force of the ground on each foot, shape (n, 4, 3), N."""
        return -self._feet[:, :, 1:]

    @property
    def body_contact(self) -> NDArray[np.bool_]:
        """Whether the body or a leg touches the ground elsewhere than with a foot, shape (n,).

        Always False in a model with ``MjcfOptions(collision="feet")``.
        """
        elsewhere: NDArray[np.bool_] = self._ncon > self._feet[:, :, 0].sum(axis=1)
        return elsewhere

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Simulations in which MuJoCo met a number that is not finite or too large, or ran out of room, shape (n,).

        MuJoCo puts such a simulation back to the model's rest state; its numbers mean nothing until a reset.
        """
        return np.asarray(self._warning_counts().any(axis=1))

    def _warning_counts(self) -> NDArray[np.int32]:
        counts: NDArray[np.int32] = self._batch.warning[:, mujoco.mjtWarning.mjWARN_CONTACTFULL.value :, 1]
        return counts
