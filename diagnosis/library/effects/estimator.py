"""A state estimator that lies: body velocity, attitude, contact flags."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.body.contact_events import ContactSignals
from diagnosis.channels.body.dynamics import DynamicsSignals
from diagnosis.channels.body.inertial import InertialSignals
from diagnosis.channels.body.stance import StanceSignals
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.channels.low_pass import low_pass
from diagnosis.library.base import STEPS, Coefficient, Grid, LibraryEffect, Location, legs_of
from diagnosis.library.effects.rigid_body import channel_part
from diagnosis.library.experiments import OTHER_GROUND, TAPED_DISTANCE, TURN, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.sensing.contact_delay import ContactDelay
from spot_model.effects.sensing.imu_tilt import ImuTilt
from spot_model.effects.sensing.velocity_estimate import VelocityEstimate
from spot_model.robot import facts
from spot_model.robot.rotation import multiply_wxyz, rotate_wxyz

TILT_STEP_RAD: Final = 0.01


class VelocityEstimateEntry(LibraryEffect):
    """Reported velocity = scale · low-pass(v) + bias: all standing feet seem to move alike."""

    title: ClassVar[str] = "estimated body velocity"
    effect: ClassVar[type[Effect]] = VelocityEstimate
    channels: ClassVar[tuple[Channel, ...]] = (Channel.STANCE_KINEMATICS, Channel.INERTIAL_UNIT)
    location: ClassVar[Location] = Location.ROBOT
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("scale", "1", -0.7, 1.0),
        Coefficient("bias_x_m_s", "m/s", -1.0, 1.0),
        Coefficient("bias_y_m_s", "m/s", -1.0, 1.0),
        Coefficient("late", "1", 1.0, 1.0),
    )
    grid: ClassVar[Grid] = {"lag_s": (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)}
    nearby: ClassVar[Grid] = {"lag_s": STEPS}
    confused_with: ClassVar[tuple[str, ...]] = ("foot_radius", "ground_friction", "imu_tilt")
    split_by: ClassVar[Experiment] = TAPED_DISTANCE

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """Velocities of the feet; accelerations of the unit."""
        return np.array(["velocity" in name or "acceleration" in name for name in view.rows])

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The reported velocity, one along x and y of the body, and what a low pass of the velocity leaves behind.

        The true velocity's rate is the inertial unit's acceleration where there is one, which is far less noisy.
        """
        if view.name == Channel.INERTIAL_UNIT:
            s: InertialSignals = view.signals
            scale = -s.finish_rate(s.linear_vel_in_odom_m_s)
            # The estimator's filter works on the components in the body frame.
            rate = s.velocity_rate_in_body_m_s2
            passed = low_pass(s.stack, rate, shape["lag_s"])
            turning = np.cross(s.angular_vel_in_body_rad_s, shape["lag_s"] * passed)
            late = s.finish(rotate_wxyz(s.odom_from_body_wxyz, rate - passed + turning))
            return np.stack([scale, np.zeros_like(scale), np.zeros_like(scale), late], axis=2)
        k: StanceSignals = view.signals
        velocity = k.kinematics.linear_vel_in_body_m_s
        one = np.ones(len(velocity))
        zero = np.zeros(len(velocity))
        along, across = np.stack([one, zero, zero], axis=1), np.stack([zero, one, zero], axis=1)
        # A low pass lags by its time constant times the rate of what comes out of it.
        rate = low_pass(k.stack, k.acceleration_in_body_m_s2, shape["lag_s"])
        late = -shape["lag_s"] * rate
        return np.stack([k.finish_velocity(v) for v in (velocity, along, across, late)], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Scale, bias and lag; columns are of the reported velocity, which is itself scaled."""
        share, x, y, _ = (float(c) for c in coefficients)
        scale = 1.0 / (1.0 - min(share, 0.5))
        return {"scale": scale, "bias_x_m_s": x * scale, "bias_y_m_s": y * scale, "lag_s": float(shape["lag_s"])}


class ImuTiltEntry(LibraryEffect):
    """A believed body frame that is rolled and pitched against the true one."""

    title: ClassVar[str] = "tilted inertial unit"
    effect: ClassVar[type[Effect]] = ImuTilt
    channels: ClassVar[tuple[Channel, ...]] = (Channel.BASE_WRENCH, Channel.STANCE_KINEMATICS, Channel.INERTIAL_UNIT)
    location: ClassVar[Location] = Location.ROBOT
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("roll_rad", "rad", -0.3, 0.3),
        Coefficient("pitch_rad", "rad", -0.3, 0.3),
    )
    grid: ClassVar[Grid] = {"packets_are_tilted": (1.0, 0.0)}
    """Whether the unit's own packets are tilted with the attitude."""
    confused_with: ClassVar[tuple[str, ...]] = ("com_offset", "encoder_offset", "velocity_estimate")
    split_by: ClassVar[Experiment] = TURN

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """All rows, but of the unit's turn rates."""
        return np.array(["turn" not in name for name in view.rows])

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What a corrected frame would change."""
        return np.stack([self._column(view, shape, axis) for axis in (0, 1)], axis=2)

    def _column(self, view: ChannelView, shape: Shape, axis: int) -> Array:
        half = 0.5 * TILT_STEP_RAD
        back = np.array([np.cos(half), 0.0, 0.0, 0.0])
        back[1 + axis] = -np.sin(half)
        packets_are_tilted = bool(shape["packets_are_tilted"])
        if view.name == Channel.INERTIAL_UNIT:
            i: InertialSignals = view.signals
            if packets_are_tilted:
                return np.zeros((view.n, len(view.rows)))
            right = multiply_wxyz(i.odom_from_body_wxyz, np.broadcast_to(back, i.odom_from_body_wxyz.shape))
            tilted = rotate_wxyz(i.odom_from_body_wxyz, i.reading_m_s2)
            return i.finish(tilted - rotate_wxyz(right, i.reading_m_s2)) / TILT_STEP_RAD
        # Vectors in odom are reported right; those in the body frame turn with it.
        if view.name == Channel.STANCE_KINEMATICS:
            k: StanceSignals = view.signals
            into = np.broadcast_to(back * np.array([1.0, -1.0, -1.0, -1.0]), (k.stack.n, 4))
            believed = k.kinematics
            changed = k.corrected(
                ("imu_tilt", axis),
                odom_from_body_wxyz=multiply_wxyz(
                    believed.odom_from_body_wxyz, np.broadcast_to(back, believed.odom_from_body_wxyz.shape)
                ),
                linear_vel_in_body_m_s=rotate_wxyz(into, believed.linear_vel_in_body_m_s),
                angular_vel_in_body_rad_s=rotate_wxyz(into, believed.angular_vel_in_body_rad_s),
            )
            return (k.nominal - changed) / TILT_STEP_RAD
        s: DynamicsSignals = view.signals
        inputs = s.inputs
        n = len(inputs.position_rad)
        into = np.broadcast_to(back * np.array([1.0, -1.0, -1.0, -1.0]), (n, 4))
        right = multiply_wxyz(inputs.world_from_body_wxyz, np.broadcast_to(back, (n, 4)))
        acceleration = inputs.linear_acc_in_world_m_s2
        if not packets_are_tilted and s.uses_imu:
            # An untilted packet was turned by the tilted attitude, gravity with it.
            felt = acceleration + np.array([0.0, 0.0, s.imu_gravity_m_s2])
            acceleration = acceleration + rotate_wxyz(right, _back(inputs.world_from_body_wxyz, felt)) - felt
        residuals = s.with_inputs(
            ("imu_tilt", axis, packets_are_tilted),
            world_from_body_wxyz=right,
            linear_acc_in_world_m_s2=acceleration,
            angular_vel_in_body_rad_s=rotate_wxyz(into, inputs.angular_vel_in_body_rad_s),
            angular_acc_in_body_rad_s2=rotate_wxyz(into, inputs.angular_acc_in_body_rad_s2),
        )
        return (channel_part(s.reference, view) - channel_part(residuals, view)) / TILT_STEP_RAD


def _back(world_from_body_wxyz: Array, vector: Array) -> Array:
    return np.asarray(rotate_wxyz(world_from_body_wxyz * np.array([1.0, -1.0, -1.0, -1.0]), vector))


class ContactDelayEntry(LibraryEffect):
    """Flags that change after the force does."""

    title: ClassVar[str] = "late contact flags"
    effect: ClassVar[type[Effect]] = ContactDelay
    channels: ClassVar[tuple[Channel, ...]] = (Channel.CONTACT_EVENTS,)
    location: ClassVar[Location] = Location.LEG
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("delay_s", "s", 0.0, 0.3),)
    confused_with: ClassVar[tuple[str, ...]] = ("ground_compliance",)
    split_by: ClassVar[Experiment] = OTHER_GROUND

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """Rows of the flags."""
        return np.array([name.endswith("_flag") for name in view.rows]) & legs_of(joints, view)[view.row_leg]

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One."""
        _: ContactSignals = view.signals
        out = np.zeros((view.n, len(view.rows), 1))
        out[:, : facts.N_LEGS, 0] = legs_of(joints, view)
        return out
