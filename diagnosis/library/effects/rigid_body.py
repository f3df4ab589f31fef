"""Masses, centres of mass and inertias: inverse dynamics by their own derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals, Residuals
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.library.base import Coefficient, Grid, LibraryEffect, Location
from diagnosis.library.experiments import MIRROR, STAND, WALK, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.body.body_inertia import BodyInertia
from spot_model.effects.body.com_offset import ComOffset
from spot_model.effects.body.leg_mass import LegMass
from spot_model.effects.body.payload_mass import PayloadMass
from spot_model.robot.facts import JOINT_NAMES

KNOTS_M: Final = (0.1, 0.2, 0.3)
"""Places of a point mass on a link whose columns give those of all others."""


def joint_names(joints: Flags) -> tuple[str, ...]:
    """Names of the chosen joints of Spot."""
    return tuple(name for name, chosen in zip(JOINT_NAMES, joints, strict=True) if chosen)


def channel_part(residuals: Residuals, view: ChannelView) -> Array:
    """The rows of the residuals that channel *load to motion* or *base wrench* shows."""
    return residuals.joint_nm if view.name == Channel.LOAD_TO_MOTION else residuals.base


def derivative(view: ChannelView, effect: Effect, step: float) -> Array:
    """What one unit of a model effect's parameter adds to the response; shape (n, R).

    With the true model the response would be none, so the nominal one shows the step's change with the sign turned.
    """
    s: DynamicsSignals = view.signals
    changed = s.with_effect((effect.name, effect.joints, tuple(effect.values.items())), effect)
    return (channel_part(s.reference, view) - channel_part(changed, view)) / step


class _BodyEntry(LibraryEffect):
    channels: ClassVar[tuple[Channel, ...]] = (Channel.BASE_WRENCH,)
    location: ClassVar[Location] = Location.ROBOT

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """All rows."""
        return np.ones(len(view.rows), dtype=np.bool_)


class LegMassEntry(LibraryEffect):
    """Mass of the links that the joints move, scaled: spread as the link's own, or a point so far down from the joint.

    The torque of a swing goes with the square of that distance: half a kilogram at the foot is as hard to swing as two
    halfway up.
    """

    title: ClassVar[str] = "mass of leg links"
    effect: ClassVar[type[Effect]] = LegMass
    channels: ClassVar[tuple[Channel, ...]] = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("scale", "1", -0.6, 4.0),)
    nearby: ClassVar[Grid] = {"down_m": (0.8, 1.25)}
    confused_with: ClassVar[tuple[str, ...]] = ("payload_mass", "encoder_offset", "load_sensor_gain")
    split_by: ClassVar[Experiment] = Experiment("swing_legs", "Walk fast: swinging legs weigh their links.", WALK)

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Spread as the link's own mass, which is one number less, and points halfway down and near the link's end."""
        return ({}, {"down_m": 0.15}, {"down_m": 0.3})

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Points nearby."""
        return super().neighbours(shape) if shape else ()

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The torque that mass and inertia of what is added take, for each time the links' own mass."""
        names = joint_names(joints)
        if not shape:
            return derivative(view, LegMass(joints=names, scale=1.1), 0.1)[:, :, None]
        down_m = shape["down_m"]
        # A point's weight, moment and inertia go with powers of its distance up to the second: three places tell all.
        parts = [derivative(view, LegMass(joints=names, scale=1.1, down_m=k), 0.1) for k in KNOTS_M]
        shares = [np.prod([(down_m - k) / (at - k) for k in KNOTS_M if k != at]) for at in KNOTS_M]
        return np.asarray(sum(share * part for share, part in zip(shares, parts, strict=True)))[:, :, None]


class PayloadEntry(_BodyEntry):
    """A mass on the body, with its place."""

    title: ClassVar[str] = "payload"
    effect: ClassVar[type[Effect]] = PayloadMass
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("mass_kg", "kg", -5.0, 20.0),
        Coefficient("moment_x_kg_m", "kg·m", -5.0, 5.0),
        Coefficient("moment_y_kg_m", "kg·m", -3.0, 3.0),
        Coefficient("moment_z_kg_m", "kg·m", -5.0, 5.0),
    )
    contains: ClassVar[tuple[str, ...]] = ("com_offset",)
    confused_with: ClassVar[tuple[str, ...]] = ("com_offset", "load_sensor_gain", "leg_mass")
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One kilogram at the body's origin, and one kilogram-metre of first moment along each axis."""
        mass = derivative(view, PayloadMass(mass_kg=1.0), 1.0)
        moments = []
        for axis in ("x_m", "y_m", "z_m"):
            place: dict[str, Any] = {axis: 0.1}
            moments.append((derivative(view, PayloadMass(mass_kg=1.0, **place), 1.0) - mass) / 0.1)
        return np.stack([mass, *moments], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Mass and place; a place only where there is mass enough to have one."""
        mass, *moments = (float(c) for c in coefficients)
        bounds = (0.5, 0.2, (-0.3, 0.5))
        if abs(mass) < 0.2:
            return {"mass_kg": mass}
        low_high = [(-b, b) if isinstance(b, float) else b for b in bounds]
        places = [float(np.clip(m / mass, low, high)) for m, (low, high) in zip(moments, low_high, strict=True)]
        return {"mass_kg": mass, "x_m": places[0], "y_m": places[1], "z_m": places[2]}


class ComEntry(_BodyEntry):
    """The body's centre of mass elsewhere."""

    title: ClassVar[str] = "centre of mass of the body"
    effect: ClassVar[type[Effect]] = ComOffset
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("x_m", "m", -0.2, 0.2),
        Coefficient("y_m", "m", -0.1, 0.1),
        Coefficient("z_m", "m", -0.1, 0.1),
    )
    confused_with: ClassVar[tuple[str, ...]] = ("payload_mass", "imu_tilt", "load_sensor_gain")
    split_by: ClassVar[Experiment] = MIRROR

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """A centimetre along each axis, per metre."""
        return np.stack(
            [derivative(view, e, 0.01) for e in (ComOffset(x_m=0.01), ComOffset(y_m=0.01), ComOffset(z_m=0.01))], axis=2
        )


class InertiaEntry(_BodyEntry):
    """The body's inertia scaled."""

    title: ClassVar[str] = "rotational inertia of the body"
    effect: ClassVar[type[Effect]] = BodyInertia
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("scale", "1", -0.7, 2.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("com_offset", "payload_mass")
    split_by: ClassVar[Experiment] = MIRROR

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The moment that the inertia takes."""
        return derivative(view, BodyInertia(scale=1.1), 0.1)[:, :, None]
