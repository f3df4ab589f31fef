"""A mass that swings on the body: a loosely hung payload, a cable, a sloshing tank."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from scipy.signal import bilinear, lfilter, lfilter_zi

from diagnosis.channels.body.base_motion import GRAVITY_M_S2, base_motion
from diagnosis.channels.body.dynamics import DynamicsSignals
from diagnosis.channels.body.vectors import cross
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.library.base import WIDE_STEPS, Coefficient, Grid, LibraryEffect, Location
from diagnosis.library.effects.rigid_body import PayloadEntry
from diagnosis.library.experiments import STAND, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.body.payload_mass import PayloadMass
from spot_model.robot.rotation import rotate_inverse_wxyz

OWN: tuple[str, ...] = ("frequency_hz", "damping", "bounces")
"""Numbers that no simulated payload has."""


class SwingingMassEntry(LibraryEffect):
    """A mass on a spring, or a pendulum: a payload whose share of the body's acceleration passes a resonance.

    The body feels m·(a + g) of a mass that is fixed. One that swings at ω with damping ζ passes a on by
    (2ζω·s + ω²) / (s² + 2ζω·s + ω²): whole when slow, more at its own frequency, and none when fast. A pendulum does so
    across, a mass on a spring along the vertical too. It rings on after a start or a turn, in no phase with the stride.

    It is seen, not simulated: a simulator gets the same mass, fixed.
    """

    name: ClassVar[str] = "swinging_mass"
    title: ClassVar[str] = "mass that swings on the body (simulated as if fixed)"
    effect: ClassVar[type[Effect]] = PayloadMass
    channels: ClassVar[tuple[Channel, ...]] = (Channel.BASE_WRENCH,)
    location: ClassVar[Location] = Location.ROBOT
    coefficients: ClassVar[tuple[Coefficient, ...]] = (
        Coefficient("mass_kg", "kg", 0.0, 20.0),
        *PayloadEntry.coefficients[1:],
    )
    least: ClassVar[Mapping[str, float]] = {"mass_kg": 0.3}
    contains: ClassVar[tuple[str, ...]] = ("payload_mass", "com_offset")
    confused_with: ClassVar[tuple[str, ...]] = ("payload_mass", "com_offset", "leg_mass")
    split_by: ClassVar[Experiment] = STAND
    grid: ClassVar[Grid] = {
        "frequency_hz": (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6),
        "damping": (0.05, 0.2),
        "bounces": (0.0, 1.0),
    }
    nearby: ClassVar[Grid] = {"frequency_hz": (0.85, 0.93, 1.07, 1.16), "damping": WIDE_STEPS}

    def show(self, views: Views) -> tuple[Channel, ...]:
        """Only by an inertial unit's acceleration: that of a differentiated velocity is ten times as noisy."""
        view = views.get(Channel.BASE_WRENCH)
        return super().show(views) if view is not None and view.signals.uses_imu else ()

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """All rows."""
        return np.ones(len(view.rows), dtype=np.bool_)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """Force of one kilogram at the body's origin, and moments of one kilogram-metre along each axis."""
        s: DynamicsSignals = view.signals
        force = passed_on_m_s2(s, shape)
        none = np.zeros_like(force)
        moments = [np.concatenate([none, cross(np.eye(3)[axis], force)], axis=1) for axis in range(3)]
        return np.stack([np.concatenate([force, none], axis=1), *moments], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Mass, place and how it swings."""
        return {**PayloadEntry().values(coefficients, {}), **{name: float(shape[name]) for name in OWN}}

    def make(self, values: Mapping[str, float], joints: tuple[str, ...]) -> Effect:
        """The same mass, fixed."""
        return PayloadMass(joints=joints, **{k: v for k, v in values.items() if k not in OWN})


def passed_on_m_s2(s: DynamicsSignals, shape: Shape) -> Array:
    """Force of each kilogram on the body, body frame, at the kept rows. Shape (n, 3)."""
    stack = s.stack
    if "specific_force" not in s.cache:
        base = base_motion(stack)
        up = base.linear_acc_in_odom_m_s2 + np.array([0.0, 0.0, GRAVITY_M_S2])
        s.cache["specific_force"] = stack.smooth(np.asarray(rotate_inverse_wxyz(base.odom_from_body_wxyz, up)))
    force = s.cache["specific_force"].copy()
    omega, axes = 2.0 * np.pi * shape["frequency_hz"], slice(0, 3 if shape["bounces"] else 2)
    damped = 2.0 * shape["damping"] * omega
    above, below = bilinear([damped, omega**2], [1.0, damped, omega**2], fs=1.0 / stack.period_s)
    at_rest = lfilter_zi(above, below)[:, None]
    for number in range(len(stack.recordings)):
        own = np.flatnonzero(stack.run == number)
        across = force[own, axes]
        force[own, axes], _ = lfilter(above, below, across, axis=0, zi=at_rest * across[:1])
    return np.asarray(force[s.rows])
