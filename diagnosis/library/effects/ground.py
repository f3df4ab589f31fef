"""Feet and ground: size of the feet, grip, softness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.body.contact_events import STOP_PER_TIME_CONSTANT, ContactSignals, vertical_force_n
from diagnosis.channels.body.stance import StanceSignals
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.library.base import Coefficient, LibraryEffect, Location, legs_of
from diagnosis.library.experiments import OTHER_GROUND, STAND, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.body.foot_radius import FootRadius
from spot_model.effects.body.ground_compliance import GroundCompliance
from spot_model.effects.body.ground_friction import GroundFriction
from spot_model.robot import facts

RADIUS_STEP_M: Final = 0.005
FRONT: Final = np.array([name.startswith("f") for name in facts.LEG_NAMES])


class FootRadiusEntry(LibraryEffect):
    """Feet larger or smaller: contact points lie lower, and roll further."""

    title: ClassVar[str] = "size of the feet"
    effect: ClassVar[type[Effect]] = FootRadius
    channels: ClassVar[tuple[Channel, ...]] = (Channel.STANCE_KINEMATICS,)
    location: ClassVar[Location] = Location.LEG
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("change_m", "m", -0.012, 0.012),)
    confused_with: ClassVar[tuple[str, ...]] = ("encoder_offset", "velocity_estimate", "ground_compliance")
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What feet of the right size would change."""
        k: StanceSignals = view.signals
        legs = legs_of(joints, view)
        changed = k.corrected(
            ("foot_radius", tuple(np.flatnonzero(legs))), foot_radius_m=k.foot_radius_m + RADIUS_STEP_M * legs
        )
        return (k.nominal - changed)[:, :, None] / RADIUS_STEP_M


class GroundFrictionEntry(LibraryEffect):
    """The ratio of shear to normal force at which a loaded foot slips."""

    title: ClassVar[str] = "grip of the ground"
    effect: ClassVar[type[Effect]] = GroundFriction
    channels: ClassVar[tuple[Channel, ...]] = (Channel.CONTACT_EVENTS,)
    location: ClassVar[Location] = Location.LEG
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("scale", "1", -0.95, 2.0),)
    # Wet tiles, 0.3, against the simulator's 0.8.
    largest: ClassVar[Mapping[str, float]] = {"scale": 0.6}
    confused_with: ClassVar[tuple[str, ...]] = ("velocity_estimate", "encoder_offset")
    split_by: ClassVar[Experiment] = OTHER_GROUND

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """Rows of the slips."""
        return np.array([name.endswith("_slip") for name in view.rows]) & legs_of(joints, view)[view.row_leg]

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The nominal coefficient."""
        s: ContactSignals = view.signals
        out = np.zeros((view.n, len(view.rows), 1))
        out[:, facts.N_LEGS : 2 * facts.N_LEGS, 0] = s.friction * legs_of(joints, view)
        return out


class GroundComplianceEntry(LibraryEffect):
    """Feet that the ground takes longer to stop, in proportion to the contact's time constant."""

    title: ClassVar[str] = "soft ground"
    effect: ClassVar[type[Effect]] = GroundCompliance
    channels: ClassVar[tuple[Channel, ...]] = (Channel.CONTACT_EVENTS, Channel.STANCE_KINEMATICS)
    location: ClassVar[Location] = Location.LEG
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("time_constant_s", "s", 0.0, 0.19),
        Coefficient("front_depth_m_per_n", "m/N", 0.0, 1e-3),
        Coefficient("hind_depth_m_per_n", "m/N", 0.0, 1e-3),
    )
    least: ClassVar[Mapping[str, float]] = {"time_constant_s": 1e-3}
    confused_with: ClassVar[tuple[str, ...]] = ("joint_compliance", "contact_delay", "foot_radius")
    split_by: ClassVar[Experiment] = OTHER_GROUND

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """Rows of the stops, and all of the stance: heights count from the mean of those that stand."""
        if view.name == Channel.STANCE_KINEMATICS:
            return np.ones(len(view.rows), dtype=np.bool_)
        return np.array([name.endswith("_stop") for name in view.rows]) & legs_of(joints, view)[view.row_leg]

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """A share in the time of a stop; in the stance, a foot lies lower the more it carries.

        Feet that carry less roll more, so that front and hind feet do not lie lower alike.
        """
        out = np.zeros((view.n, len(view.rows), 3))
        legs = legs_of(joints, view)
        if view.name == Channel.STANCE_KINEMATICS:
            out[:, :, 1], out[:, :, 2] = _sunk(view.signals, legs & FRONT), _sunk(view.signals, legs & ~FRONT)
            return out
        out[:, 2 * facts.N_LEGS :, 0] = STOP_PER_TIME_CONSTANT * legs
        return out


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
