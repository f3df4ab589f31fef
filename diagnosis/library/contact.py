"""Feet and ground (size, grip, softness), and a state estimator that lies (velocity, attitude, contact flags)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Shape
from diagnosis.channels.body_model import BodyModel
from diagnosis.channels.contact_events import STOP_PER_TIME_CONSTANT, vertical_force_n
from diagnosis.channels.dynamics import DynamicsSignals
from diagnosis.channels.kinematics import InertialSignals, StanceSignals
from diagnosis.library import STEPS, Coefficient, LibraryEffect, Location, ShapeGrid, constant_columns, legs_with
from diagnosis.library.experiments import OTHER_GROUND, STAND, TAPED_DISTANCE, TURN
from spot_model.effects.bodies import FootRadius, GroundCompliance, GroundFriction
from spot_model.effects.estimator import ContactDelay, ImuTilt, VelocityEstimate
from spot_model.robot import facts
from spot_model.robot.rotation import multiply_wxyz, rotate_wxyz

RADIUS_STEP_M: Final = 0.005
FRONT: Final = np.array([name.startswith("f") for name in facts.LEG_NAMES])


class FootRadiusEntry(LibraryEffect):
    """Feet larger or smaller: contact points lie lower, and roll further."""

    title = "size of the feet"
    family = "another ground"
    effect = FootRadius
    channels = (Channel.STANCE_KINEMATICS,)
    location = Location.LEG
    coefficients = (Coefficient("change_m", "m", -0.012, 0.012),)
    confused_with = ("encoder_offset", "velocity_estimate", "ground_compliance")
    split_by = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What feet of the right size would change."""
        k: StanceSignals = view.signals
        legs = legs_with(joints, view)
        key = ("foot_radius", tuple(np.flatnonzero(legs)))
        radius = k.inputs.foot_radius_m + RADIUS_STEP_M * legs
        return k.correction(view.name, key, foot_radius_m=radius)[:, :, None] / RADIUS_STEP_M


class GroundFrictionEntry(LibraryEffect):
    """The ratio of shear to normal force at which a loaded foot slips."""

    title = "grip of the ground"
    family = "another ground"
    effect = GroundFriction
    channels = (Channel.CONTACT_EVENTS,)
    location = Location.LEG
    coefficients = (Coefficient("scale", "1", -0.95, 2.0),)
    # Wet tiles, 0.3, against the simulator's 0.8.
    largest: ClassVar[Mapping[str, float]] = {"scale": 0.6}
    confused_with = ("velocity_estimate", "encoder_offset")
    split_by = OTHER_GROUND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The nominal coefficient."""
        s: BodyModel = view.signals
        return constant_columns(view, np.kron([0.0, 1.0, 0.0], s.foot_friction * legs_with(joints, view)))


class GroundComplianceEntry(LibraryEffect):
    """Feet that the ground takes longer to stop, in proportion to the contact's time constant."""

    title = "soft ground"
    family = "another ground"
    effect = GroundCompliance
    channels = (Channel.CONTACT_EVENTS, Channel.STANCE_KINEMATICS)
    location = Location.LEG
    coefficients = (
        Coefficient("time_constant_s", "s", 0.0, 0.19),
        Coefficient("front_depth_m_per_n", "m/N", 0.0, 1e-3),
        Coefficient("hind_depth_m_per_n", "m/N", 0.0, 1e-3),
    )
    least: ClassVar[Mapping[str, float]] = {"time_constant_s": 1e-3}
    confused_with = ("joint_compliance", "contact_delay", "foot_radius")
    split_by = OTHER_GROUND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """A share in the time of a stop; in the stance, a foot lies lower the more it carries.

        Feet that carry less roll more, so that front and hind feet do not lie lower alike.
        """
        legs = legs_with(joints, view)
        if view.name == Channel.STANCE_KINEMATICS:
            front, hind = _sunk(view.signals, legs & FRONT), _sunk(view.signals, legs & ~FRONT)
            return np.stack([np.zeros_like(front), front, hind], axis=2)
        none = np.zeros(len(view.rows))
        return constant_columns(view, np.kron([0.0, 0.0, STOP_PER_TIME_CONSTANT], legs), none, none)


def _sunk(k: StanceSignals, legs: Flags) -> Array:
    """Vertical velocities and heights of the standing feet (n, 16) for each metre that a newton sinks them in."""
    out = np.zeros((len(k.rows), 4 * facts.N_LEGS))
    if k.dynamics is None:
        return out
    if "force" not in k.cache:
        k.cache["force"] = np.maximum(vertical_force_n(k.dynamics), 0.0)
    force: Array = k.cache["force"]
    mine = np.where(k.standing & legs, force, 0.0)
    mean = mine.sum(axis=1, keepdims=True) / np.maximum(k.standing.sum(axis=1, keepdims=True), 1)
    out[:, 2 : 3 * facts.N_LEGS : 3] = -k.stack.rate(force, k.rows) * legs
    out[:, 3 * facts.N_LEGS :] = -(mine - mean)[k.rows]
    return out


TILT_STEP_RAD: Final = 0.01
CONJUGATE: Final = np.array([1.0, -1.0, -1.0, -1.0])
LARGEST_SHARE: Final = 0.9
"""Of a reported velocity that is not there: beyond any bound, and still a number."""


class VelocityEstimateEntry(LibraryEffect):
    """Reported velocity = scale · low-pass(v) + bias: all standing feet seem to move alike."""

    title = "estimated body velocity"
    family = "an error of the state estimate"
    effect = VelocityEstimate
    channels = (Channel.STANCE_KINEMATICS, Channel.INERTIAL_UNIT)
    location = Location.ROBOT
    coefficients = (
        Coefficient("scale", "1", -0.7, 0.5),
        Coefficient("bias_x_m_s", "m/s", -1.0, 1.0),
        Coefficient("bias_y_m_s", "m/s", -1.0, 1.0),
        Coefficient("late", "1", 1.0, 1.0),
    )
    grid: ClassVar[ShapeGrid] = {"lag_s": (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)}
    nearby: ClassVar[ShapeGrid] = {"lag_s": STEPS}
    confused_with = ("foot_radius", "ground_friction", "imu_tilt")
    split_by = TAPED_DISTANCE

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The reported velocity, one along x and y of the body, and what a low pass of the velocity leaves behind.

        The true velocity's rate is the inertial unit's acceleration where there is one, which is far less noisy.
        """
        if view.name == Channel.INERTIAL_UNIT:
            s: InertialSignals = view.signals
            scale = -s.finish_rate(s.stack.states.linear_vel_of_body_in_odom_m_s)
            # The estimator's filter works on the components in the body frame.
            rate = s.velocity_rate_in_body_m_s2
            passed = s.stack.low_pass(rate, shape["lag_s"])
            turning = np.cross(s.stack.angular_vel_in_body_rad_s, shape["lag_s"] * passed)
            late = s.finish(rotate_wxyz(s.stack.states.odom_from_body_wxyz, rate - passed + turning))
            return np.stack([scale, np.zeros_like(scale), np.zeros_like(scale), late], axis=2)
        k: StanceSignals = view.signals
        velocity = k.raw.linear_vel_in_body_m_s
        along, across = (np.tile(axis, (len(velocity), 1)) for axis in np.eye(3)[:2])
        # A low pass lags by its time constant times the rate of what comes out of it.
        late = -shape["lag_s"] * k.stack.low_pass(k.acceleration_in_body_m_s2, shape["lag_s"])
        return np.stack([k.finish_velocity(v) for v in (velocity, along, across, late)], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Scale, bias and lag; columns are of the reported velocity, which is itself scaled."""
        share, x, y, _ = (float(c) for c in coefficients)
        scale = 1.0 / (1.0 - min(share, LARGEST_SHARE))
        return {"scale": scale, "bias_x_m_s": x * scale, "bias_y_m_s": y * scale, "lag_s": float(shape["lag_s"])}

    def inverse(self, values: Mapping[str, float]) -> tuple[Array, Shape]:
        """Coefficients and shape of these values."""
        scale = values["scale"]
        moved = (values["bias_x_m_s"] / scale, values["bias_y_m_s"] / scale)
        return np.array([1.0 - 1.0 / scale, *moved, 1.0]), {"lag_s": values["lag_s"]}


class ImuTiltEntry(LibraryEffect):
    """A believed body frame that is rolled and pitched against the true one."""

    title = "tilted inertial unit"
    family = "a sensor's error"
    effect = ImuTilt
    channels = (Channel.BASE_WRENCH, Channel.STANCE_KINEMATICS, Channel.INERTIAL_UNIT)
    location = Location.ROBOT
    coefficients = (Coefficient("roll_rad", "rad", -0.3, 0.3), Coefficient("pitch_rad", "rad", -0.3, 0.3))
    grid: ClassVar[ShapeGrid] = {"packets_are_tilted": (1.0, 0.0)}
    """Whether the unit's own packets are tilted with the attitude."""
    confused_with = ("ground_slope", "com_offset", "encoder_offset", "velocity_estimate")
    split_by = TURN

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What a corrected frame would change."""
        return np.stack([self._column(view, shape, axis) for axis in (0, 1)], axis=2)

    def _column(self, view: ChannelView, shape: Shape, axis: int) -> Array:
        half = 0.5 * TILT_STEP_RAD
        back = np.array([np.cos(half), 0.0, 0.0, 0.0])
        back[1 + axis] = -np.sin(half)

        def turned_back(attitude: Array) -> Array:
            return np.asarray(multiply_wxyz(attitude, np.broadcast_to(back, attitude.shape)))

        # Vectors in odom are reported right; those in the body frame turn with it.
        def into_right(vector: Array) -> Array:
            return np.asarray(rotate_wxyz(np.broadcast_to(back * CONJUGATE, (len(vector), 4)), vector))

        packets_are_tilted = bool(shape["packets_are_tilted"])
        if view.name == Channel.INERTIAL_UNIT:
            i: InertialSignals = view.signals
            if packets_are_tilted:
                return np.zeros((view.n, len(view.rows)))
            right = turned_back(i.stack.states.odom_from_body_wxyz)
            change = i.stack.imu_in_odom_m_s2 - rotate_wxyz(right, i.stack.imu.acceleration_m_s2)
            return i.finish(change) / TILT_STEP_RAD
        if view.name == Channel.STANCE_KINEMATICS:
            k: StanceSignals = view.signals
            change = k.correction(
                view.name,
                ("imu_tilt", axis),
                odom_from_body_wxyz=turned_back(k.inputs.odom_from_body_wxyz),
                linear_vel_in_body_m_s=into_right(k.inputs.linear_vel_in_body_m_s),
                angular_vel_in_body_rad_s=into_right(k.inputs.angular_vel_in_body_rad_s),
            )
            return change / TILT_STEP_RAD
        s: DynamicsSignals = view.signals
        tilted, acceleration = s.inputs.world_from_body_wxyz, s.inputs.linear_acc_in_world_m_s2
        right = turned_back(tilted)
        if not packets_are_tilted and s.stack.imu_gravity_m_s2 is not None:
            # An untilted packet was turned by the tilted attitude, gravity with it.
            felt = acceleration + np.array([0.0, 0.0, s.stack.imu_gravity_m_s2])
            acceleration = acceleration + rotate_wxyz(right, rotate_wxyz(tilted * CONJUGATE, felt)) - felt
        change = s.correction(
            view.name,
            ("imu_tilt", axis, packets_are_tilted),
            world_from_body_wxyz=right,
            linear_acc_in_world_m_s2=acceleration,
            angular_vel_in_body_rad_s=into_right(s.inputs.angular_vel_in_body_rad_s),
            angular_acc_in_body_rad_s2=into_right(s.inputs.angular_acc_in_body_rad_s2),
        )
        return change / TILT_STEP_RAD


class ContactDelayEntry(LibraryEffect):
    """Flags that change after the force does."""

    title = "late contact flags"
    family = "an error of the state estimate"
    effect = ContactDelay
    channels = (Channel.CONTACT_EVENTS,)
    location = Location.LEG
    coefficients = (Coefficient("delay_s", "s", 0.0, 0.3),)
    confused_with = ("ground_compliance",)
    split_by = OTHER_GROUND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One."""
        return constant_columns(view, np.kron([1.0, 0.0, 0.0], legs_with(joints, view)))
