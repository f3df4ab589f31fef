"""How the logged body moves, what forces this takes by the nominal model's rigid body, and what loads say of them.

Accelerations are the inertial unit's where there is one; its packets are older than their state by their own stamps,
and are brought forward. The model is without contact, friction and rotors: inverse dynamics seen from the links.

With a leg's loads τ and the model's joint rows h_leg, the ground's force on its foot is f = J⁻ᵀ(h_leg − τ). The feet's
forces come from the loads of all four legs, whatever their contact flags say; force and moment are in the body's frame,
about its origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from diagnosis.channels import Array, Channel
from diagnosis.channels.stack import Stack
from spot_model.effects.base import Effect
from spot_model.plant.model_fields import FIRST_JOINT_DOF, edit_model
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf
from spot_model.robot.rotation import rotate_inverse_wxyz, rotate_wxyz

N_DOFS = FIRST_JOINT_DOF + facts.N_JOINTS


@dataclass(frozen=True)
class BodyInputs:
    """What inverse dynamics start from, n rows; a correction of a sensor replaces one of these."""

    world_from_body_wxyz: Array
    angular_vel_in_body_rad_s: Array
    linear_acc_in_world_m_s2: Array
    angular_acc_in_body_rad_s2: Array
    position_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    load_nm: Array


@dataclass(frozen=True)
class Residuals:
    """What the model and the loads disagree on."""

    joint_nm: Array
    """Load less what the model needs if no foot touches. Shape (n, 12)."""
    base: Array
    """Force (N) and moment (N·m) by which the feet's forces exceed what the body needs, body frame. Shape (n, 6)."""
    foot_force_n: Array
    """Ground's force on each foot by the loads, body frame. Shape (n, 4, 3)."""

    def of(self, channel: Channel) -> Array:
        """What channel *load to motion* or *base wrench* shows."""
        return self.joint_nm if channel == Channel.LOAD_TO_MOTION else self.base


class BodyModel:
    """Spot's rigid body with the masses, centres of mass and inertias that a robot model's effects edit.

    Their friction and rotor inertia do not count, since loads are measured behind them.
    """

    def __init__(self, effects: Sequence[Effect] = ()) -> None:
        model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(collision="feet", visuals=False)))
        edit_model(model, effects)
        model.dof_frictionloss[:] = 0.0
        model.dof_damping[:] = 0.0
        model.dof_armature[:] = 0.0
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= (
            off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT | off.mjDSBL_SENSOR | off.mjDSBL_ACTUATION | off.mjDSBL_LIMIT
        )
        self.effects = tuple(effects)
        self._model = model
        self._data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self._data)
        self.foot_radius_m = np.array([model.geom(f"{leg}_foot").size[0] for leg in facts.LEG_NAMES])
        """Shape (4,)."""
        self.foot_friction = np.array([model.geom(f"{leg}_foot").friction[0] for leg in facts.LEG_NAMES])
        """Sliding friction coefficient, shape (4,)."""

    def inverse_dynamics(self, x: BodyInputs) -> Array:
        """Generalised forces that make this motion, gravity included; shape (n, 18).

        Force on the body in the world, moment about the body's origin in the body, joint torques. The body's velocity
        does not matter: the equations of motion are the same in every steadily moving frame.
        """
        n = len(x.position_rad)
        at_rest = np.zeros((n, 3))
        positions = np.concatenate([at_rest, x.world_from_body_wxyz, x.position_rad], axis=1)
        velocities = np.concatenate([at_rest, x.angular_vel_in_body_rad_s, x.velocity_rad_s], axis=1)
        accelerations = np.concatenate(
            [x.linear_acc_in_world_m_s2, x.angular_acc_in_body_rad_s2, x.acceleration_rad_s2], axis=1
        )
        out = np.empty((n, N_DOFS))
        data, model = self._data, self._model
        qpos, qvel, qacc = data.qpos, data.qvel, data.qacc
        # What is left of mj_inverse without contact, constraints, passive forces and rotors: a fifth faster.
        for i in range(n):
            qpos[:] = positions[i]
            qvel[:] = velocities[i]
            qacc[:] = accelerations[i]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, out[i])
        return out


def full_rate_inputs(stack: Stack, load_nm: Array) -> BodyInputs:
    """The motion at the states' stamps, not smoothed, its accelerations without gravity.

    The body's acceleration is the inertial unit's where there is one, else the derivative of the estimator's velocity.
    """
    attitude = stack.states.odom_from_body_wxyz
    length = np.linalg.norm(attitude, axis=1, keepdims=True)
    attitude = np.where(length > 0.5, attitude / np.maximum(length, 0.5), np.array([1.0, 0.0, 0.0, 0.0]))
    if stack.has("imu.angular_vel_rad_s"):
        turn = forward(stack.imu.angular_vel_rad_s, stack)
    else:
        turn = np.asarray(rotate_inverse_wxyz(attitude, stack.states.angular_vel_of_body_in_odom_rad_s))
    gravity = stack.imu_gravity_m_s2
    if gravity is None:
        acceleration = central_slope(stack.states.linear_vel_of_body_in_odom_m_s, stack.period_s)
    else:
        reading = rotate_wxyz(attitude, stack.imu.acceleration_m_s2)
        acceleration = forward(np.asarray(reading), stack) - np.array([0.0, 0.0, gravity])
    velocity = stack.states.velocity_rad_s
    return BodyInputs(
        world_from_body_wxyz=attitude,
        angular_vel_in_body_rad_s=turn,
        linear_acc_in_world_m_s2=acceleration,
        angular_acc_in_body_rad_s2=central_slope(turn, stack.period_s),
        position_rad=stack.states.position_rad,
        velocity_rad_s=velocity,
        acceleration_rad_s2=central_slope(velocity, stack.period_s),
        load_nm=load_nm,
    )


def forward(values: Array, stack: Stack) -> Array:
    """Readings of the inertial unit brought forward by their age, by the straight line to the next; same shape."""
    share = stack.imu.age_s / stack.period_s
    following = np.concatenate([values[1:], values[-1:]])
    return np.asarray(values + share * (following - values))


def central_slope(values: Array, period_s: float) -> Array:
    """Derivative along the first axis by the fourth-order central difference: 0.3 % short at 30 Hz on a 3 ms stream."""
    near = np.roll(values, -1, axis=0) - np.roll(values, 1, axis=0)
    far = np.roll(values, -2, axis=0) - np.roll(values, 2, axis=0)
    return np.asarray((8.0 * near - far) / (12.0 * period_s))


def residuals(
    model: BodyModel, inputs: BodyInputs, *, force: Array | None = None, place: tuple[Array, Array] | None = None
) -> Residuals:
    """Inverse dynamics of the motion against the loads; ``force`` and ``place`` where they are known already."""
    if force is None:
        force = model.inverse_dynamics(inputs)
    joint = inputs.load_nm - force[:, FIRST_JOINT_DOF:]
    wrench = feet_wrench(place or place_of_feet(inputs, model.foot_radius_m), joint)
    needed = np.concatenate([rotate_inverse_wxyz(inputs.world_from_body_wxyz, force[:, :3]), force[:, 3:6]], axis=1)
    return Residuals(joint_nm=joint, base=wrench.sum(axis=1) - needed, foot_force_n=wrench[:, :, :3])


def feet_wrench(place: tuple[Array, Array], joint_nm: Array) -> Array:
    """Force and moment on the body of the feet's forces that a joint residual (n, 12) stands for, leg by leg.

    Shape (n, 4, 6), body frame, about the body's origin; ``place`` as :func:`place_of_feet` has it.
    """
    point, lever = place
    torque = -joint_nm.reshape(len(joint_nm), facts.N_LEGS, 3, 1)
    force = (lever @ torque)[..., 0]
    return np.concatenate([force, np.cross(point, force)], axis=2)


def place_of_feet(inputs: BodyInputs, foot_radius_m: Array) -> tuple[Array, Array]:
    """Contact points (n, 4, 3), m, and what makes forces on them of their legs' torques (n, 4, 3, 3), 1/m."""
    point, jacobian = contact_point_and_jacobian(inputs.position_rad, inputs.world_from_body_wxyz, foot_radius_m)
    # Near a stretched leg the Jacobian is singular, and the force along the leg large but right.
    return point, np.asarray(np.linalg.inv(np.swapaxes(jacobian, -1, -2) + 1e-6 * np.eye(3)), dtype=np.float64)


def contact_point_and_jacobian(
    position_rad: Array, world_from_body_wxyz: Array, foot_radius_m: Array
) -> tuple[Array, Array]:
    """Lowest points of the foot spheres in the body frame, and their Jacobians as points of the lower legs.

    Positions (n, 4, 3), m; Jacobians (n, 4, 3, 3), m/rad.
    """
    centre, jacobian = foot_position_and_jacobian(position_rad)
    down = rotate_inverse_wxyz(world_from_body_wxyz, np.broadcast_to([0.0, 0.0, -1.0], (len(position_rad), 3)))
    arm = foot_radius_m[None, :, None] * down[:, None, :]
    axes = leg_axes(position_rad)
    turned = np.swapaxes(np.cross(axes, arm[:, :, None, :]), -1, -2)
    return centre + arm, jacobian + turned


def leg_axes(position_rad: Array) -> Array:
    """Axes of each leg's three joints in the body frame, shape (n, 4, 3 joints, 3)."""
    hx = position_rad[:, 0::3]
    zero, one = np.zeros_like(hx), np.ones_like(hx)
    along = np.stack([one, zero, zero], axis=-1)
    across = np.stack([zero, np.cos(hx), np.sin(hx)], axis=-1)
    return np.stack([along, across, across], axis=2)
