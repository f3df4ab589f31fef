"""Losses that oppose motion: dry, viscous, Stribeck, load-dependent friction."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.library.base import WIDE_STEPS, Coefficient, Grid, LibraryEffect, on_joints
from diagnosis.library.experiments import LOADED_WALK, OTHER_KD, SLOW_WALK
from spot_model.effects.drive.coulomb_friction import CoulombFriction
from spot_model.effects.drive.load_friction import LoadFriction
from spot_model.effects.drive.stribeck_friction import StribeckFriction
from spot_model.effects.drive.viscous_friction import ViscousFriction
from spot_model.effects.friction import smooth_sign
from trainer.signals.motor_torque import presliding

BUILDS_UP_RAD: Final = "builds_up_rad"
FASTEST_RAD_S: Final = 1.2
"""Friction that fades over a wider range of speeds is no Stribeck friction: real ones fade within 1 rad/s."""


class CoulombEntry(LibraryEffect):
    """−F·sign(q̇): the same at any torque and speed; after a reversal it may build up over a distance."""

    title = "dry friction"
    effect = CoulombFriction
    coefficients = (Coefficient("level_nm", "N·m", 0.0, 5.0),)
    grid: ClassVar[Grid] = {BUILDS_UP_RAD: (0.0, 0.004, 0.015)}
    nearby: ClassVar[Grid] = {BUILDS_UP_RAD: (0.6, 1.6)}
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
        s.cache[key] = presliding(s.position_rad, s.stack.run, distance_rad)
    found: Array = s.cache[key]
    return found


class ViscousEntry(LibraryEffect):
    """−D·q̇; at one set of gains the same as a larger kd."""

    effect = ViscousFriction
    coefficients = (Coefficient("damping_nm_s_per_rad", "N·m·s/rad", 0.0, 5.0),)
    confused_with = ("coulomb_friction", "torque_bandwidth", "torque_speed_curve")
    split_by = OTHER_KD


class StribeckEntry(LibraryEffect):
    """−F·exp(−(q̇/v)²)·sign(q̇): only near standstill; it, too, may build up over a distance."""

    title = "friction near standstill (Stribeck)"
    effect = StribeckFriction
    coefficients = (Coefficient("level_nm", "N·m", 0.0, 10.0),)
    grid: ClassVar[Grid] = {BUILDS_UP_RAD: (0.0015, 0.005), "speed_rad_s": (0.2, 0.4, 0.8)}
    nearby: ClassVar[Grid] = {"speed_rad_s": WIDE_STEPS}
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
    effect = LoadFriction
    coefficients = (Coefficient("share", "1", 0.0, 0.9),)
    confused_with = ("coulomb_friction", "torque_gain", "backlash")
    split_by = LOADED_WALK

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The loss at a share of 1, from the measured load."""
        s: ActuatorSignals = view.signals
        return on_joints(s.finish(-np.abs(s.load_nm) * smooth_sign(s.velocity_rad_s)), joints)
