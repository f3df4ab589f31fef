"""What the drive does to a torque without a limit: friction, gain, rotor inertia, lag, heat, a constant, play."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints, Shape, Views
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.library import (
    ALL_OF_IT,
    STEPS,
    WIDE_STEPS,
    Coefficient,
    LibraryEffect,
    ShapeGrid,
    constant_columns,
    on_joints,
)
from diagnosis.library.experiments import LOADED_WALK, LONG_WALK, OTHER_KD, OTHER_KP, SLOW_WALK, STAND
from spot_model.effects.base import Motion
from spot_model.effects.drivetrain import Backlash, TorqueBandwidth, TorqueDelay, TorqueGain, TorqueOffset
from spot_model.effects.friction import (
    Armature,
    CoulombFriction,
    LoadFriction,
    StribeckFriction,
    ViscousFriction,
    smooth_sign,
)
from spot_model.effects.power import ThermalDerating
from trainer.signals.motor_torque import presliding, runs_side_by_side

BUILDS_UP_RAD: Final = "builds_up_rad"
FASTEST_RAD_S: Final = 1.2
"""Friction that fades over a wider range of speeds is no Stribeck friction: real ones fade within 1 rad/s."""


class CoulombEntry(LibraryEffect):
    """−F·sign(q̇): the same at any torque and speed; after a reversal it may build up over a distance."""

    title = "dry friction"
    family = "friction"
    effect = CoulombFriction
    coefficients = (Coefficient("level_nm", "N·m", 0.0, 5.0),)
    grid: ClassVar[ShapeGrid] = {BUILDS_UP_RAD: (0.0, 0.004, 0.015)}
    nearby: ClassVar[ShapeGrid] = {BUILDS_UP_RAD: (0.6, 1.6)}
    confused_with = ("stribeck_friction", "load_friction", "viscous_friction")
    split_by = LOADED_WALK

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The direction of motion, negative, at once or built up."""
        if not shape.get(BUILDS_UP_RAD):
            return super().columns(view, shape, joints)
        return on_joints(view.signals.finish(-_built_up(view.signals, shape[BUILDS_UP_RAD])), joints)


def _built_up(s: ActuatorSignals, distance_rad: float) -> Array:
    """Direction against which dry friction acts, -1 to 1, built up over a distance; shape (N, J)."""
    key = ("presliding", distance_rad)
    if key not in s.cache:
        s.cache[key] = presliding(s.position_rad, s.stack.run, distance_rad).astype(np.float32)
    found: Array = s.cache[key]
    return found


class ViscousEntry(LibraryEffect):
    """−D·q̇; at one set of gains the same as a larger kd."""

    family = "friction"
    effect = ViscousFriction
    coefficients = (Coefficient("damping_nm_s_per_rad", "N·m·s/rad", 0.0, 5.0),)
    confused_with = ("coulomb_friction", "torque_bandwidth", "torque_speed_curve")
    split_by = OTHER_KD


class StribeckEntry(LibraryEffect):
    """−F·exp(−(q̇/v)²)·sign(q̇): only near standstill; it, too, may build up over a distance."""

    title = "friction near standstill (Stribeck)"
    family = "friction"
    is_quick = True
    effect = StribeckFriction
    coefficients = (Coefficient("level_nm", "N·m", 0.0, 10.0),)
    grid: ClassVar[ShapeGrid] = {BUILDS_UP_RAD: (0.0015, 0.005), "speed_rad_s": (0.2, 0.4, 0.8)}
    nearby: ClassVar[ShapeGrid] = {"speed_rad_s": WIDE_STEPS}
    confused_with = ("coulomb_friction", "backlash")
    split_by = SLOW_WALK

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Speeds nearby."""
        return tuple(s for s in super().neighbours(shape) if s["speed_rad_s"] <= FASTEST_RAD_S)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The fading direction of motion, negative, built up."""
        s: ActuatorSignals = view.signals
        fading = np.exp(-((s.still_velocity_rad_s / shape["speed_rad_s"]) ** 2))
        return on_joints(s.finish(-fading * _built_up(s, shape[BUILDS_UP_RAD])), joints)


class LoadFrictionEntry(LibraryEffect):
    """−k·|g|·sign(q̇), with g the load that is measured behind the gear: its efficiency."""

    title = "friction that grows with load"
    family = "friction"
    effect = LoadFriction
    coefficients = (Coefficient("share", "1", 0.0, 0.9),)
    confused_with = ("coulomb_friction", "torque_gain", "backlash")
    split_by = LOADED_WALK

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The loss at a share of 1, from the measured load."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(-np.abs(s.load_nm) * smooth_sign(s.velocity_rad_s)), joints)


GRID_RAD: Final = tuple(round(0.0008 * 1.2**i, 7) for i in range(24))
"""Widths that are tried, up to 0.053 rad."""
COARSE: Final = 4
"""Every so many are tried first; computed together, they cost little more than one."""
GAP_PER_KNOCK_RAD: Final = 7.5e-4
"""Width of a gap by the variance of its knocks, in usual variances of a load; 6 to 9e-4 on three simulated robots.

A rotor that crosses a gap of twice the width arrives with twice the energy.
"""
SUBSTEPS: Final = 2
"""Steps of the motor's motion in the gap between two states."""


class TorqueGainEntry(LibraryEffect):
    """(g − 1)·τ: the motor gives a constant share."""

    family = "a wrong torque scale"
    effect = TorqueGain
    coefficients = (Coefficient("gain", "1", -0.9, 2.0),)
    confused_with = ("load_sensor_gain", "thermal_derating", "load_friction", "torque_limit", "position_torque_limit")
    split_by = OTHER_KP


class ArmatureEntry(LibraryEffect):
    """−I·q̈: torque that accelerates the rotor; the load is measured behind it."""

    title = "reflected rotor inertia"
    family = "inertia"
    effect = Armature
    coefficients = (Coefficient("inertia_kg_m2", "kg·m²", 0.0, 0.5),)
    confused_with = ("torque_bandwidth", "power_limit")
    split_by = SLOW_WALK


class BandwidthEntry(LibraryEffect):
    """A first-order lag of the torque."""

    title = "slow torque loop"
    family = "a lag or delay"
    is_quick = True
    effect = TorqueBandwidth
    coefficients = (ALL_OF_IT,)
    grid: ClassVar[ShapeGrid] = {"time_constant_s": (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)}
    nearby: ClassVar[ShapeGrid] = {"time_constant_s": STEPS}
    confused_with = ("torque_delay", "armature", "viscous_friction")
    split_by = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The slow torque less the torque."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(s.stack.low_pass(s.torque_nm, shape["time_constant_s"]) - s.torque_nm), joints)


class DelayEntry(LibraryEffect):
    """The torque that was asked for a while ago; a delay that all joints share is in part the load's lag."""

    title = "delay of the torque"
    family = "a lag or delay"
    is_quick = True
    effect = TorqueDelay
    coefficients = (ALL_OF_IT,)
    grid: ClassVar[ShapeGrid] = {"delay_s": (0.001, 0.002, 0.004, 0.008, 0.016)}
    nearby: ClassVar[ShapeGrid] = {"delay_s": STEPS}
    confused_with = ("torque_bandwidth", "command_delay", "load_sensor_gain")
    split_by = OTHER_KP

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The late torque less the torque."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(s.delayed(s.torque_nm, shape["delay_s"]) - s.torque_nm), joints)


class ThermalEntry(LibraryEffect):
    """−k·θ·τ with the rise θ heated by τ²; heating and cooling as the simulator's defaults, so k alone is fitted."""

    title = "loss of torque with heat"
    family = "a wrong torque scale"
    effect = ThermalDerating
    coefficients = (Coefficient("loss_per_k", "1/K", 0.0, 0.1),)
    confused_with = ("torque_gain", "bus_sag")
    split_by = LONG_WALK


class TorqueOffsetEntry(LibraryEffect):
    """A constant beside what is asked for: there while the robot stands, too, unlike a ripple.

    The load is right and so is the motion it makes: a load cell's zero shows in the body's channels as well, an
    encoder's in those alone. Without them, or where the load is computed from the motor's own current, a torque and a
    zero are one. Where the asked torque hardly changes, a gain is the same.
    """

    title = "constant torque"
    effect = TorqueOffset
    coefficients = (Coefficient("offset_nm", "N·m", -20.0, 20.0),)
    confused_with = ("load_sensor_gain", "torque_gain", "torque_ripple", "encoder_offset")
    split_by = STAND


class BacklashEntry(LibraryEffect):
    """Torque missing while the motor crosses a gap after each reversal; knocks, and a load that rattles."""

    title = "play in the gear"
    family = "play in the gear"
    is_quick = True
    effect = Backlash
    channels = (Channel.SET_POINT_TO_LOAD, Channel.SENSOR_NOISE)
    coefficients = (
        ALL_OF_IT,
        Coefficient("knocks", "usual variances", 0.0, 40.0),
        Coefficient("rattle", "usual variances", 0.0, 40.0),
    )
    confused_with = (
        "coulomb_friction",
        "torque_gain",
        "torque_bandwidth",
        "sensor_noise",
        "joint_compliance",
        "viscous_friction",
    )
    split_by = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Widths of the gap."""
        return tuple({"gap_rad": g} for g in GRID_RAD[1::COARSE])

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Widths nearby."""
        at = GRID_RAD.index(shape["gap_rad"])
        return tuple({"gap_rad": GRID_RAD[i]} for i in (at - 2, at - 1, at + 1, at + 2) if 0 <= i < len(GRID_RAD))

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The torque that does not come through, by the simulator's own formula; knocks and noise of the load."""
        if view.name == Channel.SENSOR_NOISE:
            _, _, rattle, knocks = (np.kron(group, joints) for group in np.eye(4))
            return constant_columns(view, np.zeros(len(view.rows)), knocks, rattle)
        s: ActuatorSignals = view.signals
        if ("backlash", shape["gap_rad"]) not in s.cache:
            coarse = GRID_RAD[1::COARSE]
            gaps = coarse if shape["gap_rad"] in coarse else GRID_RAD
            for gap, passed in zip(
                gaps, passed_on_nm(s.torque_nm, np.array(gaps), s.stack.run, s.period_s), strict=True
            ):
                s.cache["backlash", gap] = s.finish(passed - s.torque_nm).astype(np.float32)
        missing: Array = s.cache["backlash", shape["gap_rad"]]
        return np.pad(on_joints(missing, joints), ((0, 0), (0, 0), (0, 2)))

    def show(self, views: Views) -> tuple[Channel, ...]:
        """Without channel *set-point to load* nobody knows what a load should be."""
        return super().show(views) if Channel.SET_POINT_TO_LOAD in views else ()

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Gap: from the missing torque, or from the knocks where they speak of a wider one."""
        return {"gap_rad": max(float(shape["gap_rad"]), GAP_PER_KNOCK_RAD * float(coefficients[1]))}


def passed_on_nm(torque_nm: Array, gap_rad: Array, run: Ints, period_s: float) -> Iterator[Array]:
    """The torque (N, J) that gaps of some widths (G,) let through, by the simulator's formula, all recordings at once.

    One width after the other, each of shape (N, J). Meanwhile only whether it is passed on is kept: all of it, or none.
    """
    (motor,), (row, recording) = runs_side_by_side(run, torque_nm)
    whole = np.empty((len(gap_rad), *motor.shape[1:]))
    effect = Backlash(gap_rad=gap_rad[:, None, None]).arrays_like(whole)
    memory = effect.start(whole)
    motion = Motion(whole, whole, period_s / SUBSTEPS)
    out = np.empty((len(gap_rad), *motor.shape), dtype=np.bool_)
    for k, torque in enumerate(motor):
        whole[:] = torque
        # The load at a state is that of the last step before it.
        for _ in range(SUBSTEPS):
            passed, memory = effect.torque(whole, motion, memory)
        out[:, k] = passed != 0.0
    return (np.where(own[row, recording], torque_nm, 0.0) for own in out)
