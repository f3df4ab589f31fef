"""Losses that oppose motion: dry, viscous, Stribeck, load-dependent friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.channels.drive.nominal_torque import FRICTION_SPEED_RAD_S, presliding
from diagnosis.library.base import Coefficient, LibraryEffect, on_joints
from diagnosis.library.experiments import LOADED_WALK, OTHER_KD, SLOW_WALK, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.drive.coulomb_friction import CoulombFriction
from spot_model.effects.drive.load_friction import LoadFriction
from spot_model.effects.drive.stribeck_friction import StribeckFriction
from spot_model.effects.drive.viscous_friction import ViscousFriction
from spot_model.effects.friction import smooth_sign

BUILDS_UP_RAD: Final = "builds_up_rad"
FASTEST_RAD_S: Final = 1.2
"""Friction that fades over a wider range of speeds is no Stribeck friction: real ones fade within 1 rad/s."""


class CoulombEntry(LibraryEffect):
    """−F·sign(q̇): the same at any torque and speed; after a reversal it may build up over a distance."""

    name: ClassVar[str] = "coulomb_friction"
    title: ClassVar[str] = "dry friction"
    effect: ClassVar[type[Effect]] = CoulombFriction
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("level_nm", "N·m", 0.0, 5.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("stribeck_friction", "load_friction", "viscous_friction")
    split_by: ClassVar[Experiment] = LOADED_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Distances over which it builds up; 0: at once, as in the simulator."""
        return tuple({BUILDS_UP_RAD: d} for d in (0.0, 0.004, 0.015))

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Distances nearby."""
        return tuple({BUILDS_UP_RAD: shape[BUILDS_UP_RAD] * f} for f in (0.6, 1.6) if shape[BUILDS_UP_RAD] > 0.0)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The direction of motion, negative."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(-_towards(s, shape.get(BUILDS_UP_RAD, 0.0), FRICTION_SPEED_RAD_S)), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Friction level."""
        return {"level_nm": float(coefficients[0])}


def _towards(s: ActuatorSignals, distance_rad: float, smooth_rad_s: float) -> Array:
    """Direction against which dry friction acts, -1 to 1, built up over a distance, or smooth in the speed; (N, J)."""
    if distance_rad == 0.0:
        return np.asarray(smooth_sign(s.still_velocity_rad_s, smooth_rad_s))
    key = ("presliding", distance_rad)
    if key not in s.cache:
        s.cache[key] = presliding(s.position_rad, s.stack.starts(), distance_rad)
    found: Array = s.cache[key]
    return found


class ViscousEntry(LibraryEffect):
    """−D·q̇; at one set of gains the same as a larger kd."""

    name: ClassVar[str] = "viscous_friction"
    title: ClassVar[str] = "viscous friction"
    effect: ClassVar[type[Effect]] = ViscousFriction
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("damping_nm_s_per_rad", "N·m·s/rad", 0.0, 5.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb_friction", "torque_bandwidth", "torque_speed_curve")
    split_by: ClassVar[Experiment] = OTHER_KD

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The velocity, negative."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(-s.velocity_rad_s), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Damping."""
        return {"damping_nm_s_per_rad": float(coefficients[0])}


class StribeckEntry(LibraryEffect):
    """−F·exp(−(q̇/v)²)·sign(q̇): only near standstill; it, too, may build up over a distance."""

    name: ClassVar[str] = "stribeck_friction"
    title: ClassVar[str] = "friction near standstill (Stribeck)"
    effect: ClassVar[type[Effect]] = StribeckFriction
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("level_nm", "N·m", 0.0, 10.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb_friction", "backlash")
    split_by: ClassVar[Experiment] = SLOW_WALK

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Speeds over which it fades, with and without a distance over which it builds up."""
        return tuple({"speed_rad_s": v, BUILDS_UP_RAD: d} for d in (0.0, 0.004) for v in (0.2, 0.4, 0.8))

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Speeds nearby."""
        near = (shape["speed_rad_s"] * f for f in (0.72, 0.85, 1.19, 1.4))
        return tuple({**shape, "speed_rad_s": v} for v in near if v <= FASTEST_RAD_S)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The fading direction of motion, negative."""
        s: ActuatorSignals = view.signals
        speed = s.still_velocity_rad_s
        # The simulator's formula smooths the sign over 0.1 rad/s.
        towards = _towards(s, shape.get(BUILDS_UP_RAD, 0.0), 0.1)
        return on_joints(s.finish(-np.exp(-((speed / shape["speed_rad_s"]) ** 2)) * towards), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Level and speed."""
        return {"level_nm": float(coefficients[0]), "speed_rad_s": float(shape["speed_rad_s"])}


class LoadFrictionEntry(LibraryEffect):
    """−k·|τ|·sign(q̇): a gear's efficiency."""

    name: ClassVar[str] = "load_friction"
    title: ClassVar[str] = "friction that grows with load"
    effect: ClassVar[type[Effect]] = LoadFriction
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("share", "1", 0.0, 0.9),)
    confused_with: ClassVar[tuple[str, ...]] = ("coulomb_friction", "torque_gain", "backlash")
    split_by: ClassVar[Experiment] = LOADED_WALK

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The size of the torque against the direction of motion."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(-np.abs(s.torque_nm) * smooth_sign(s.still_velocity_rad_s)), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Share of the torque that is lost."""
        return {"share": float(coefficients[0])}
