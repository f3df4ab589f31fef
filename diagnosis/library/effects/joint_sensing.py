"""Joint sensors that lie: encoder zero, wind-up of the gear, torque scale and zero, velocity lag, noise.

A correction of the sensor by one step changes the residuals; the truth has none, so the change with its sign turned is
what one unit of the fault adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals
from diagnosis.channels.body.stance import StanceSignals
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.channels.drive.joint_rates import RateSignals
from diagnosis.channels.drive.sensor_noise import USUAL
from diagnosis.library.base import Coefficient, Grid, LibraryEffect, on_joints
from diagnosis.library.effects.rigid_body import channel_part
from diagnosis.library.experiments import LOADED_WALK, OTHER_KP, STAND, TURN, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.drive.joint_compliance import JointCompliance
from spot_model.effects.sensing.encoder_offset import EncoderOffset
from spot_model.effects.sensing.load_filter import LoadFilter
from spot_model.effects.sensing.load_sensor_gain import LoadSensorGain
from spot_model.effects.sensing.sensor_noise import SensorNoise
from spot_model.effects.sensing.velocity_filter import VelocityFilter

OFFSET_STEP_RAD: Final = 0.01
COMPLIANCE_STEP: Final = 2e-4
VELOCITY_OF_MOTOR: Final = "velocity_of_motor"


class EncoderOffsetEntry(LibraryEffect):
    """A constant on the reported position; the servo follows it, so channel *set-point to load* sees nothing.

    Zeros are set joint by joint: four hips that are off by the same angle are a body that stands askew.
    """

    title: ClassVar[str] = "joint encoder's zero"
    effect: ClassVar[type[Effect]] = EncoderOffset
    channels: ClassVar[tuple[Channel, ...]] = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH, Channel.STANCE_KINEMATICS)
    singly: ClassVar[bool] = True
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("offset_rad", "rad", -0.3, 0.3),)
    confused_with: ClassVar[tuple[str, ...]] = ("joint_compliance", "foot_radius", "imu_tilt", "leg_mass", "com_offset")
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What positions that are right would change."""
        key = ("encoder_offset", tuple(np.flatnonzero(joints)))
        step = OFFSET_STEP_RAD * joints
        if view.name == Channel.STANCE_KINEMATICS:
            k: StanceSignals = view.signals
            changed = k.corrected(key, position_rad=k.kinematics.position_rad - step)
            return (k.nominal - changed)[:, :, None] / OFFSET_STEP_RAD
        s: DynamicsSignals = view.signals
        residuals = s.with_inputs(key, position_rad=s.inputs.position_rad - step)
        return (channel_part(s.reference, view) - channel_part(residuals, view))[:, :, None] / OFFSET_STEP_RAD


class JointComplianceEntry(LibraryEffect):
    """Wind-up in proportion to the load, on the encoder's side.

    Whether the reported velocity is the motor's, as the position is, or the link's, is a shape.
    """

    title: ClassVar[str] = "gear that gives way"
    effect: ClassVar[type[Effect]] = JointCompliance
    channels: ClassVar[tuple[Channel, ...]] = (
        Channel.JOINT_RATES,
        Channel.LOAD_TO_MOTION,
        Channel.BASE_WRENCH,
        Channel.STANCE_KINEMATICS,
    )
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("compliance_rad_per_nm", "rad/(N·m)", 0.0, 0.02),)
    grid: ClassVar[Grid] = {VELOCITY_OF_MOTOR: (0.0, 1.0)}
    confused_with: ClassVar[tuple[str, ...]] = ("encoder_offset", "ground_compliance", "velocity_filter", "backlash")
    split_by: ClassVar[Experiment] = LOADED_WALK

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What positions without wind-up would change; where velocity is the link's, its mismatch too."""
        moves = shape.get(VELOCITY_OF_MOTOR, 0.0)
        key = ("joint_compliance", moves, tuple(np.flatnonzero(joints)))
        step = COMPLIANCE_STEP * joints
        if view.name == Channel.JOINT_RATES:
            q: RateSignals = view.signals
            load = q.stack.filled(lambda r: r.load_nm)
            return on_joints((1.0 - moves) * q.finish_rate(-load), joints)
        if view.name == Channel.STANCE_KINEMATICS:
            k: StanceSignals = view.signals
            load = k.stack.filled(lambda r: r.load_nm)
            changed = k.corrected(
                key,
                position_rad=k.kinematics.position_rad - step * load,
                velocity_rad_s=k.kinematics.velocity_rad_s - moves * step * k.stack.rate(load),
            )
            return (k.nominal - changed)[:, :, None] / COMPLIANCE_STEP
        s: DynamicsSignals = view.signals
        residuals = s.with_inputs(
            key,
            position_rad=s.inputs.position_rad - step * s.inputs.load_nm,
            velocity_rad_s=s.inputs.velocity_rad_s - moves * step * s.load_rate_nm_s,
        )
        return (channel_part(s.reference, view) - channel_part(residuals, view))[:, :, None] / COMPLIANCE_STEP


class LoadSensorEntry(LibraryEffect):
    """Reported load = gain · load + bias: what the drive gives is right, what is measured is not."""

    title: ClassVar[str] = "torque sensor's scale and zero"
    effect: ClassVar[type[Effect]] = LoadSensorGain
    of_load_cell: ClassVar[bool] = True
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("gain", "1", -0.8, 2.0),
        Coefficient("bias_nm", "N·m", -20.0, 20.0),
    )
    confused_with: ClassVar[tuple[str, ...]] = ("torque_gain", "payload_mass", "leg_mass")
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The true load and one; in A the torque that is asked for stands for the load."""
        if view.name == Channel.SET_POINT_TO_LOAD:
            a: ActuatorSignals = view.signals
            # What was measured less what explains nothing of it: the load that the model predicts.
            predicted = a.finish(a.load_nm) - view.response
            return np.concatenate([on_joints(predicted, joints), on_joints(np.ones_like(predicted), joints)], axis=2)
        s: DynamicsSignals = view.signals
        chosen = tuple(np.flatnonzero(joints))
        step = 0.01
        gain = s.with_inputs(("load_gain", chosen), load_nm=s.inputs.load_nm * (1.0 - step * joints))
        bias = s.with_inputs(("load_bias", chosen), load_nm=s.inputs.load_nm - step * joints)
        parts = [(channel_part(s.reference, view) - channel_part(part, view)) / step for part in (gain, bias)]
        return np.stack(parts, axis=2)


class LoadFilterEntry(LibraryEffect):
    """−T·dτ/dt with τ the reported load: exact for a first-order low pass, whatever the load is made of.

    A slow torque loop looks the same between set-point and load. Here the load is late against the motion, too.
    """

    name: ClassVar[str] = "load_filter"
    title: ClassVar[str] = "lag of the torque sensor"
    effect: ClassVar[type[Effect]] = LoadFilter
    of_load_cell: ClassVar[bool] = True
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("time_constant_s", "s", 0.0, 0.1),)
    least: ClassVar[Mapping[str, float]] = {"time_constant_s": 5e-4}
    confused_with: ClassVar[tuple[str, ...]] = ("torque_bandwidth", "command_delay", "armature")
    split_by: ClassVar[Experiment] = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """Rate of the reported load, negative."""
        if view.name == Channel.SET_POINT_TO_LOAD:
            a: ActuatorSignals = view.signals
            return on_joints(a.finish_rate(-a.load_nm), joints)
        s: DynamicsSignals = view.signals
        step_s = 1e-3
        key = ("load_filter", tuple(np.flatnonzero(joints)))
        late = s.with_inputs(key, load_nm=s.inputs.load_nm + step_s * s.load_rate_nm_s * joints)
        return ((channel_part(s.reference, view) - channel_part(late, view)) / step_s)[:, :, None]

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Time constant."""
        return {"time_constant_s": float(coefficients[0])}


class VelocityFilterEntry(LibraryEffect):
    """A low-passed velocity: the true one is ahead by the time constant times its rate, and is the position's slope.

    The second derivative's share tells filters apart: none for one of first order, half a square of the time constant
    for a pure delay or a Butterworth filter of second order. How much of the damping the servo takes from the true
    velocity, and how much of it the body's channels see, are shares.
    """

    title: ClassVar[str] = "lag of the joint velocity"
    effect: ClassVar[type[Effect]] = VelocityFilter
    channels: ClassVar[tuple[Channel, ...]] = (
        Channel.JOINT_RATES,
        Channel.SET_POINT_TO_LOAD,
        Channel.LOAD_TO_MOTION,
        Channel.BASE_WRENCH,
        Channel.STANCE_KINEMATICS,
    )
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("time_constant_s", "s", 0.0, 0.2),
        Coefficient("square_s2", "s²", 0.0, 1e-3),
        Coefficient("servo_share", "1", 0.0, 1.0),
        Coefficient("body_share", "1", 0.0, 1.0),
    )
    # Without a lag there is only what a slope of positions has less noise than reported velocities.
    least: ClassVar[Mapping[str, float]] = {"time_constant_s": 5e-4}
    # How feet are stopped, and where they slip, is read off the reported velocities.
    confused_with: ClassVar[tuple[str, ...]] = (
        "command_delay",
        "joint_compliance",
        "armature",
        "torque_bandwidth",
        "ground_compliance",
        "ground_friction",
    )
    split_by: ClassVar[Experiment] = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What velocities that are not late would change."""
        if view.name == Channel.JOINT_RATES:
            q: RateSignals = view.signals
            rate = q.stack.rate(q.velocity_rad_s)
            return _as_coefficients({0: q.finish_rate(-q.velocity_rad_s) * joints, 1: q.finish_rate(-rate) * joints}, 4)
        if view.name == Channel.SET_POINT_TO_LOAD:
            a: ActuatorSignals = view.signals
            ahead = a.stack.rate(a.position_rad) - a.stack.smooth(a.velocity_rad_s)
            return _as_coefficients({2: a.finish(-a.kd_nm_s_per_rad * ahead) * joints}, 4)
        key = ("velocity_filter", tuple(np.flatnonzero(joints)))
        if view.name == Channel.STANCE_KINEMATICS:
            k: StanceSignals = view.signals
            position, velocity = k.kinematics.position_rad, k.kinematics.velocity_rad_s
            changed = k.corrected(key, velocity_rad_s=velocity + joints * (k.stack.rate(position) - velocity))
            return _as_coefficients({3: k.nominal - changed}, 4)
        s: DynamicsSignals = view.signals
        ahead = s.position_rate_rad_s - s.inputs.velocity_rad_s
        faster = s.position_curvature_rad_s2 - s.inputs.acceleration_rad_s2
        residuals = s.with_inputs(
            key,
            velocity_rad_s=s.inputs.velocity_rad_s + joints * ahead,
            acceleration_rad_s2=s.inputs.acceleration_rad_s2 + joints * faster,
        )
        return _as_coefficients({3: channel_part(s.reference, view) - channel_part(residuals, view)}, 4)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Time constant, and how much of the damping is not late."""
        return {"time_constant_s": float(coefficients[0]), "unfiltered_share": float(coefficients[2])}


def _as_coefficients(columns: Mapping[int, Array], count: int) -> Array:
    """Columns (n, R) by number of their coefficient, as (n, R, count); the others are none."""
    some = next(iter(columns.values()))
    out = np.zeros((*some.shape, count))
    for number, column in columns.items():
        out[:, :, number] = column
    return out


class SensorNoiseEntry(LibraryEffect):
    """White noise beyond what is usual; coefficients are variances in units of the usual ones."""

    title: ClassVar[str] = "noise of the joint sensors"
    effect: ClassVar[type[Effect]] = SensorNoise
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SENSOR_NOISE,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("position", "usual variances", 0.0, 1e5),
        Coefficient("velocity", "usual variances", 0.0, 1e5),
        Coefficient("load", "usual variances", 0.0, 1e5),
    )
    # Ten times the usual noise.
    largest: ClassVar[Mapping[str, float]] = {"position": 100.0, "velocity": 100.0, "load": 100.0}
    confused_with: ClassVar[tuple[str, ...]] = ("torque_ripple", "backlash")
    split_by: ClassVar[Experiment] = TURN

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """The joints' three signals."""
        return np.asarray(joints[view.row_joint])

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One for each signal."""
        n_joints = len(joints)
        out = np.zeros((view.n, len(view.rows), 3))
        for signal in range(3):
            out[:, signal * n_joints : (signal + 1) * n_joints, signal] = joints
        return out

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Standard deviations of the noise that is added."""
        position, velocity, load = (float(v) for v in np.sqrt(np.maximum(coefficients, 0.0)) * USUAL)
        return {"position_rad": position, "velocity_rad_s": velocity, "load_nm": load}
