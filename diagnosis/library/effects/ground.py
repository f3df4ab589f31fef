"""Feet and ground: size of the feet, grip, softness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.body.body_model import BodyModel
from diagnosis.channels.body.contact_events import STOP_PER_TIME_CONSTANT, vertical_force_n
from diagnosis.channels.body.stance import StanceSignals
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.library.base import Coefficient, LibraryEffect, Location, constant_columns, legs_of
from diagnosis.library.experiments import OTHER_GROUND, STAND
from spot_model.effects.body.foot_radius import FootRadius
from spot_model.effects.body.ground_compliance import GroundCompliance
from spot_model.effects.body.ground_friction import GroundFriction
from spot_model.robot import facts

RADIUS_STEP_M: Final = 0.005
FRONT: Final = np.array([name.startswith("f") for name in facts.LEG_NAMES])


class FootRadiusEntry(LibraryEffect):
    """Feet larger or smaller: contact points lie lower, and roll further."""

    title = "size of the feet"
    effect = FootRadius
    channels = (Channel.STANCE_KINEMATICS,)
    location = Location.LEG
    coefficients = (Coefficient("change_m", "m", -0.012, 0.012),)
    confused_with = ("encoder_offset", "velocity_estimate", "ground_compliance")
    split_by = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What feet of the right size would change."""
        k: StanceSignals = view.signals
        legs = legs_of(joints, view)
        key = ("foot_radius", tuple(np.flatnonzero(legs)))
        radius = k.inputs.foot_radius_m + RADIUS_STEP_M * legs
        return k.correction(view.name, key, foot_radius_m=radius)[:, :, None] / RADIUS_STEP_M


class GroundFrictionEntry(LibraryEffect):
    """The ratio of shear to normal force at which a loaded foot slips."""

    title = "grip of the ground"
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
        return constant_columns(view, np.kron([0.0, 1.0, 0.0], s.foot_friction * legs_of(joints, view)))


class GroundComplianceEntry(LibraryEffect):
    """Feet that the ground takes longer to stop, in proportion to the contact's time constant."""

    title = "soft ground"
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
        legs = legs_of(joints, view)
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
