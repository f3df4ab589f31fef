"""The state of a batch of simulated robots: joints, body, feet, contacts, torques."""

from __future__ import annotations

from typing import Final

from array_api_compat import device

from spot_model.effects.base import BodyEstimate, JointReading
from spot_model.plant.effect_chains import OutsideChain
from spot_model.plant.model_fields import FIRST_JOINT_COORDINATE, FIRST_JOINT_DOF
from spot_model.plant.physics import FOOT_SENSOR_SIZE, Physics, PlantDivergedError
from spot_model.robot import facts
from spot_model.robot.arrays import copy_of, namespace_of
from spot_model.robot.leg_kinematics import foot_position_and_jacobian, foot_position_in_body_m
from spot_model.robot.rotation import AnyArray, cross, rotate_inverse_wxyz, rotate_wxyz

_TORQUE_AXIS = [{"hx": 0, "hy": 1, "kn": 1}[name[3:]] for name in facts.JOINT_NAMES]
_N_FOOT_VALUES = FOOT_SENSOR_SIZE * facts.N_LEGS
MOST_LOST: Final = 0.01
"""Share of contacts that may find no room: a robot that stands on four feet is then without one in one step of 25."""


class PlantState:
    """Arrays of ``n_sims`` simulations, of NumPy on the cores and of torch on a GPU; every property is a fresh copy.

    Positions and velocities are those of now. Contacts, forces, torques and accelerations are those that acted in the
    last physics step, which started one step ago; after a reset they are those of the new state without motor torque.
    """

    outside: OutsideChain
    """Gravity and what else surrounds the robots."""

    def __init__(self, physics: Physics, *, has_link_torque: bool) -> None:
        self.physics = physics
        self._has_link_torque = has_link_torque
        self._qpos: AnyArray = physics.qpos
        self._qvel, self._ctrl = physics.qvel, physics.ctrl
        self._joint_pos = self._qpos[:, FIRST_JOINT_COORDINATE:]
        self._joint_vel = self._qvel[:, FIRST_JOINT_DOF:]
        xp = namespace_of(self._qpos)
        columns = [_N_FOOT_VALUES + 3 * joint + axis for joint, axis in enumerate(_TORQUE_AXIS)]
        self._link_columns = xp.asarray(columns, device=device(self._qpos))

    @property
    def n_sims(self) -> int:
        """Number of simulations."""
        return int(self._qpos.shape[0])

    @property
    def time_s(self) -> AnyArray:
        """Time since each simulation's last reset, shape (n,), s."""
        return copy_of(self.physics.time)

    # Joints, shape (n, 12), canonical order --------------------------------------------------------------------------

    @property
    def joint_position_rad(self) -> AnyArray:
        """Joint positions, shape (n, 12), rad."""
        return copy_of(self._joint_pos)

    @property
    def joint_velocity_rad_s(self) -> AnyArray:
        """Joint velocities, shape (n, 12), rad/s."""
        return copy_of(self._joint_vel)

    @property
    def applied_torque_nm(self) -> AnyArray:
        """Motor torque after all torque effects, shape (n, 12), N·m."""
        return copy_of(self._ctrl)

    @property
    def link_torque_nm(self) -> AnyArray:
        """Torque that a sensor between gearbox and link sees, shape (n, 12), N·m.

        Motor torque less friction, damping and what accelerates the armature; at a joint stop, the stop's torque too.

        Raises:
            ValueError: The model has no such sensors.
        """
        if not self._has_link_torque:
            raise ValueError("this plant has no link-side torque; build it with MjcfOptions(link_torque_sensors=True)")
        return self.physics.sensordata[:, self._link_columns]

    def true_reading(self) -> JointReading:
        """What perfect sensors of the joints would report; the load is the link's torque where the model has it."""
        load = self.link_torque_nm if self._has_link_torque else copy_of(self._ctrl)
        return JointReading(copy_of(self._joint_pos), copy_of(self._joint_vel), load)

    def true_estimate(self) -> BodyEstimate:
        """What a perfect state estimator would report."""
        return BodyEstimate(
            linear_vel_of_body_in_body_m_s=self.linear_vel_of_body_in_body_m_s,
            angular_vel_of_body_in_body_rad_s=copy_of(self._qvel[:, 3:6]),
            world_from_body_wxyz=self.outside.in_odom(copy_of(self._qpos[:, 3:7])),
            foot_contact=namespace_of(self._qpos).astype(self.foot_contact, self._qpos.dtype),
        )

    # Body ------------------------------------------------------------------------------------------------------------

    @property
    def position_of_body_in_world_m(self) -> AnyArray:
        """Origin of the body frame, shape (n, 3), m."""
        return copy_of(self._qpos[:, :3])

    @property
    def world_from_body_wxyz(self) -> AnyArray:
        """Attitude, shape (n, 4), scalar first."""
        return copy_of(self._qpos[:, 3:7])

    @property
    def linear_vel_of_body_in_world_m_s(self) -> AnyArray:
        """Velocity of the body's origin, shape (n, 3), m/s."""
        return copy_of(self._qvel[:, :3])

    @property
    def linear_vel_of_body_in_body_m_s(self) -> AnyArray:
        """The same velocity in the body frame, shape (n, 3), m/s."""
        return rotate_inverse_wxyz(self._qpos[:, 3:7], self._qvel[:, :3])

    @property
    def angular_vel_of_body_in_body_rad_s(self) -> AnyArray:
        """Shape (n, 3), rad/s."""
        return copy_of(self._qvel[:, 3:6])

    @property
    def angular_vel_of_body_in_world_rad_s(self) -> AnyArray:
        """Shape (n, 3), rad/s."""
        return rotate_wxyz(self._qpos[:, 3:7], self._qvel[:, 3:6])

    # Feet, legs fl, fr, hl, hr ---------------------------------------------------------------------------------------

    @property
    def foot_position_in_world_m(self) -> AnyArray:
        """Centres of the foot spheres, shape (n, 4, 3), m."""
        in_body = foot_position_in_body_m(self._joint_pos)
        return self._qpos[:, None, :3] + rotate_wxyz(self._qpos[:, None, 3:7], in_body)

    @property
    def foot_velocity_in_world_m_s(self) -> AnyArray:
        """Velocity of the centres of the foot spheres, shape (n, 4, 3), m/s."""
        in_body, jacobian = foot_position_and_jacobian(self._joint_pos)
        rates = self._joint_vel.reshape(self.n_sims, facts.N_LEGS, 1, 3)
        moving = (jacobian * rates).sum(axis=-1) + cross(self._qvel[:, None, 3:6], in_body)
        return self._qvel[:, None, :3] + rotate_wxyz(self._qpos[:, None, 3:7], moving)

    @property
    def foot_contact(self) -> AnyArray:
        """Whether each foot touches the ground, shape (n, 4)."""
        return self.physics.foot_contact()

    @property
    def foot_force_in_world_n(self) -> AnyArray:
        """Force of the ground on each foot, shape (n, 4, 3), N."""
        feet = self.physics.sensordata[:, :_N_FOOT_VALUES]
        return -feet.reshape(-1, facts.N_LEGS, FOOT_SENSOR_SIZE)[:, :, 1:]

    @property
    def body_contact(self) -> AnyArray:
        """Whether the body or a leg touches the ground elsewhere than with a foot, shape (n,).

        Always False in a model with ``MjcfOptions(collision="feet")``.
        """
        return self.physics.body_contact()

    @property
    def diverged(self) -> AnyArray:
        """Simulations in which MuJoCo met a number that is not finite or too large, or ran out of room, shape (n,).

        On the cores MuJoCo puts such a simulation back to the model's rest state; its numbers mean nothing until it is
        reset.
        """
        return self.physics.diverged()

    def check_room(self) -> float:
        """Share of contacts that found no room since the last call: on a GPU, all simulations share what there is.

        Raises:
            PlantDivergedError: It is more than :data:`MOST_LOST`.
        """
        lost = self.physics.contacts_lost()
        if lost > MOST_LOST:
            raise PlantDivergedError(
                f"{lost:.1%} of the contacts of {self.n_sims} robots found no room (allowed: {MOST_LOST:.0%}): on a "
                "GPU, robots that lie on the ground take those of others; end episodes sooner, or use --device cpu"
            )
        return lost
