"""Joint sensors that lie: encoder zero, wind-up of the gear, torque scale and zero, velocity lag, noise.

A correction of the sensor by one step changes the residuals; the truth has none, so the change with its sign turned is
what one unit of the fault adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Shape
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.channels.dynamics import DynamicsSignals
from diagnosis.channels.kinematics import StanceSignals
from diagnosis.channels.sensors import USUAL, RateSignals
from diagnosis.library import Coefficient, LibraryEffect, ShapeGrid, constant_columns, on_joints
from diagnosis.library.experiments import LOADED_WALK, OTHER_KP, STAND, TURN
from spot_model.effects.joint_sensors import (
    EncoderOffset,
    JointCompliance,
    LoadFilter,
    LoadSensorGain,
    SensorNoise,
    VelocityFilter,
)
from trainer.signals.smoothing import smooth

OFFSET_STEP_RAD: Final = 0.01
COMPLIANCE_STEP: Final = 2e-4
VELOCITY_OF_MOTOR: Final = "velocity_of_motor"


class EncoderOffsetEntry(LibraryEffect):
    """A constant on the reported position; the servo follows it, so channel *set-point to load* sees nothing.

    Zeros are set joint by joint: four hips that are off by the same angle are a body that stands askew.
    """

    title = "joint encoder's zero"
    family = "a sensor's error"
    effect = EncoderOffset
    channels = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH, Channel.STANCE_KINEMATICS)
    singly = True
    coefficients = (Coefficient("offset_rad", "rad", -0.3, 0.3),)
    confused_with = ("joint_compliance", "foot_radius", "imu_tilt", "leg_mass", "com_offset")
    split_by = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What positions that are right would change."""
        s: DynamicsSignals | StanceSignals = view.signals
        right = s.inputs.position_rad - OFFSET_STEP_RAD * joints
        change = s.correction(view.name, ("encoder_offset", tuple(np.flatnonzero(joints))), position_rad=right)
        return change[:, :, None] / OFFSET_STEP_RAD


class JointComplianceEntry(LibraryEffect):
    """Wind-up in proportion to the load, on the encoder's side.

    Whether the reported velocity is the motor's, as the position is, or the link's, is a shape.
    """

    title = "gear that gives way"
    family = "play in the gear"
    effect = JointCompliance
    channels = (Channel.JOINT_RATES, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH, Channel.STANCE_KINEMATICS)
    coefficients = (Coefficient("compliance_rad_per_nm", "rad/(N·m)", 0.0, 0.02),)
    grid: ClassVar[ShapeGrid] = {VELOCITY_OF_MOTOR: (0.0, 1.0)}
    confused_with = ("encoder_offset", "ground_compliance", "velocity_filter", "backlash")
    split_by = LOADED_WALK

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What positions without wind-up would change; where velocity is the link's, its mismatch too."""
        moves = shape.get(VELOCITY_OF_MOTOR, 0.0)
        if view.name == Channel.JOINT_RATES:
            q: RateSignals = view.signals
            load = q.stack.states.load_nm
            return on_joints((1.0 - moves) * q.finish_rate(-load), joints)
        s: DynamicsSignals | StanceSignals = view.signals
        load = s.load_nm if isinstance(s, StanceSignals) else s.inputs.load_nm
        step = COMPLIANCE_STEP * joints
        change = s.correction(
            view.name,
            ("joint_compliance", moves, tuple(np.flatnonzero(joints))),
            position_rad=s.inputs.position_rad - step * load,
            velocity_rad_s=s.inputs.velocity_rad_s - moves * step * s.load_rate_nm_s,
        )
        return change[:, :, None] / COMPLIANCE_STEP


class LoadSensorEntry(LibraryEffect):
    """Reported load = gain · load + bias: what the drive gives is right, what is measured is not."""

    title = "torque sensor's scale and zero"
    family = "a sensor's error"
    effect = LoadSensorGain
    of_load_cell = True
    channels = (Channel.SET_POINT_TO_LOAD, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
    coefficients = (Coefficient("gain", "1", -0.8, 2.0), Coefficient("bias_nm", "N·m", -20.0, 20.0))
    confused_with = ("torque_gain", "payload_mass", "leg_mass")
    split_by = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The load that is expected, and one."""
        if view.name == Channel.SET_POINT_TO_LOAD:
            a: ActuatorSignals = view.signals
            # What was measured less what explains nothing of it: the load that the model predicts.
            predicted = a.finish(a.load_nm) - view.response
            return np.concatenate([on_joints(predicted, joints), on_joints(np.ones_like(predicted), joints)], axis=2)
        s: DynamicsSignals = view.signals
        load, chosen, step = s.inputs.load_nm, tuple(np.flatnonzero(joints)), 0.01
        right = {"load_gain": load * (1.0 - step * joints), "load_bias": load - step * joints}
        parts = [s.correction(view.name, (key, chosen), load_nm=true) / step for key, true in right.items()]
        # Of the load that the motion asks for: a gain would shrink the noise of a measured one, and seem to explain it.
        rows = view.row_joint
        mine = joints[rows] if (rows >= 0).all() else np.full(len(rows), np.mean(joints))
        return np.stack([parts[0] - np.nan_to_num(view.response) * mine, parts[1]], axis=2)


class LoadFilterEntry(LibraryEffect):
    """−T·dτ/dt with τ the reported load: exact for a first-order low pass, whatever the load is made of.

    A slow torque loop looks the same between set-point and load. Here the load is late against the motion, too.
    """

    title = "lag of the torque sensor"
    family = "a lag or delay"
    is_quick = True
    effect = LoadFilter
    of_load_cell = True
    channels = (Channel.SET_POINT_TO_LOAD, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
    coefficients = (Coefficient("time_constant_s", "s", 0.0, 0.1),)
    least: ClassVar[Mapping[str, float]] = {"time_constant_s": 5e-4}
    confused_with = ("torque_bandwidth", "command_delay", "armature")
    split_by = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """Rate of the reported load, negative."""
        if view.name == Channel.SET_POINT_TO_LOAD:
            a: ActuatorSignals = view.signals
            return on_joints(a.finish_rate(-a.load_nm), joints)
        s: DynamicsSignals = view.signals
        step_s = 1e-3
        key = ("load_filter", tuple(np.flatnonzero(joints)))
        ahead = s.inputs.load_nm + step_s * s.load_rate_nm_s * joints
        return s.correction(view.name, key, load_nm=ahead)[:, :, None] / step_s


class VelocityFilterEntry(LibraryEffect):
    """A low-passed velocity: the true one is ahead by the time constant times its rate, and is the position's slope.

    The second derivative's share tells filters apart. It is zero for a filter of first order. For a pure delay, or a
    Butterworth filter of second order, it is half the square of the time constant. How much of the damping the servo
    takes from the true velocity, and how much of it the body's channels see, are shares.
    """

    title = "lag of the joint velocity"
    family = "a lag or delay"
    is_quick = True
    effect = VelocityFilter
    channels = (
        Channel.JOINT_RATES,
        Channel.SET_POINT_TO_LOAD,
        Channel.LOAD_TO_MOTION,
        Channel.BASE_WRENCH,
        Channel.STANCE_KINEMATICS,
    )
    coefficients = (
        Coefficient("time_constant_s", "s", 0.0, 0.2),
        Coefficient("square_s2", "s²", 0.0, 1e-3),
        Coefficient("servo_share", "1", 0.0, 1.0),
        Coefficient("body_share", "1", 0.0, 1.0),
    )
    # Without a lag there is only what a slope of positions has less noise than reported velocities.
    least: ClassVar[Mapping[str, float]] = {"time_constant_s": 5e-4}
    # How feet are stopped, and where they slip, is read off the reported velocities.
    confused_with = (
        "command_delay",
        "joint_compliance",
        "armature",
        "torque_bandwidth",
        "ground_compliance",
        "ground_friction",
    )
    split_by = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What velocities that are not late would change."""
        if view.name == Channel.JOINT_RATES:
            q: RateSignals = view.signals
            velocity = q.stack.states.velocity_rad_s
            rates = (velocity, q.stack.rate(velocity))
            return np.pad(np.stack([q.finish_rate(-r) * joints for r in rates], axis=2), ((0, 0), (0, 0), (0, 2)))
        if view.name == Channel.SET_POINT_TO_LOAD:
            a: ActuatorSignals = view.signals
            ahead = a.stack.rate(a.position_rad) - smooth(a.velocity_rad_s)
            return np.pad(on_joints(a.finish(-a.kd_nm_s_per_rad * ahead), joints), ((0, 0), (0, 0), (2, 1)))
        s: DynamicsSignals | StanceSignals = view.signals
        velocity = s.inputs.velocity_rad_s
        right = {"velocity_rad_s": velocity + joints * (s.position_rate_rad_s - velocity)}
        if isinstance(s, DynamicsSignals):
            acceleration = s.inputs.acceleration_rad_s2
            right["acceleration_rad_s2"] = acceleration + joints * (s.position_curvature_rad_s2 - acceleration)
        change = s.correction(view.name, ("velocity_filter", tuple(np.flatnonzero(joints))), **right)
        return np.pad(change[:, :, None], ((0, 0), (0, 0), (3, 0)))

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Time constant, and how much of the damping is not late."""
        return {"time_constant_s": float(coefficients[0]), "unfiltered_share": float(coefficients[2])}

    def inverse(self, values: Mapping[str, float]) -> tuple[Array, Shape]:
        """Coefficients and shape of these values; the body's channels see all of it."""
        return np.array([values["time_constant_s"], 0.0, values["unfiltered_share"], 1.0]), {}


class SensorNoiseEntry(LibraryEffect):
    """White noise beyond what is usual; coefficients are variances in units of the usual ones."""

    title = "noise of the joint sensors"
    family = "a sensor's error"
    effect = SensorNoise
    channels = (Channel.SENSOR_NOISE,)
    coefficients = tuple(
        Coefficient(name, "usual variances", 0.0, (p.high / usual) ** 2)
        for name, p, usual in zip(
            ("position", "velocity", "load"), SensorNoise.parameters(), USUAL.tolist(), strict=True
        )
    )
    # Ten times the usual noise.
    largest: ClassVar[Mapping[str, float]] = {"position": 100.0, "velocity": 100.0, "load": 100.0}
    confused_with = ("torque_ripple", "backlash")
    split_by = TURN

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One for each signal."""
        return constant_columns(view, *(np.kron(group, joints) for group in np.eye(4)[:3]))

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Standard deviations of the noise that is added, negative where it is less."""
        position, velocity, load = (float(v) for v in np.sign(coefficients) * np.sqrt(np.abs(coefficients)) * USUAL)
        return {"position_rad": position, "velocity_rad_s": velocity, "load_nm": load}

    def inverse(self, values: Mapping[str, float]) -> tuple[Array, Shape]:
        """Variances of the noise that is added."""
        return (np.array([values[name] for name in ("position_rad", "velocity_rad_s", "load_nm")]) / USUAL) ** 2, {}
