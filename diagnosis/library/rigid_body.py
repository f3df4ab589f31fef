"""Masses, fixed or swinging, centres of mass and inertias: inverse dynamics by their own derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np
from scipy.signal import bilinear, lfilter, lfilter_zi

from diagnosis.channels import Array, Channel, ChannelView, Flags, Shape, Views
from diagnosis.channels.body_model import full_rate_inputs
from diagnosis.channels.dynamics import DynamicsSignals
from diagnosis.channels.stack import GRAVITY_M_S2
from diagnosis.decision_constants import CLEARLY_ORDINARY, ERROR_SCALES
from diagnosis.library import WIDE_STEPS, Coefficient, LibraryEffect, Location, ShapeGrid
from diagnosis.library.experiments import MIRROR, STAND, WALK, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.bodies import BodyInertia, ComOffset, LegMass, PayloadMass
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import BODY, JOINT_NAMES
from spot_model.robot.rotation import rotate_inverse_wxyz
from trainer.signals.smoothing import smooth

KNOTS_M: Final = (0.1, 0.2, 0.3)
"""Places of a point mass on a link whose columns give those of all others."""
PLACE_M: Final = ((-0.5, -0.2, -0.3), (0.5, 0.2, 0.5))
"""Lowest and highest place of a payload."""
PLACE: Final = ("x_m", "y_m", "z_m")
PAYLOAD_KG: Final = CLEARLY_ORDINARY * ERROR_SCALES["payload_mass"].scales["mass_kg"]
"""What weighs more is no error of the body's own mass."""
DIGITS: Final = 12
LEAST_M: Final = 10.0**-DIGITS
"""Rounding."""
SWINGS: Final = ("frequency_hz", "damping", "bounces")
"""Numbers of a mass that swings, which no simulated payload has."""


def derivative(view: ChannelView, effect: Effect, step: float) -> Array:
    """What one unit of a model effect's parameter adds to the response; shape (n, R).

    With the true model the response would be none, so the nominal one shows the step's change with the sign turned.
    """
    s: DynamicsSignals = view.signals
    return s.change_by(view.name, (effect.name, effect.joints, tuple(effect.values.items())), effect) / step


class _BodyEntry(LibraryEffect):
    channels = (Channel.BASE_WRENCH,)
    location = Location.ROBOT


class LegMassEntry(LibraryEffect):
    """Mass of the links that the joints move, scaled: spread as the link's own, or a point so far down from the joint.

    The torque of a swing goes with the square of that distance: half a kilogram at the foot is as hard to swing as two
    halfway up.
    """

    title = "mass of leg links"
    family = "mass of the legs"
    effect = LegMass
    channels = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
    coefficients = (Coefficient("scale", "1", -0.6, 4.0),)
    nearby: ClassVar[ShapeGrid] = {"down_m": (0.8, 1.25)}
    confused_with = ("payload_mass", "encoder_offset", "load_sensor_gain")
    split_by = Experiment("swing_legs", "Walk fast: swinging legs weigh their links.", WALK)

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Spread as the link's own mass, which is one number less, and points halfway down and near the link's end."""
        return ({}, {"down_m": 0.15}, {"down_m": 0.3})

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Points nearby."""
        return super().neighbours(shape) if shape else ()

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The torque that mass and inertia of what is added take, for each time the links' own mass."""
        names = tuple(np.array(JOINT_NAMES)[joints].tolist())
        if not shape:
            return derivative(view, LegMass(joints=names, scale=1.1), 0.1)[:, :, None]
        down_m = shape["down_m"]
        # A point's weight, moment and inertia go with powers of its distance up to the second: three places tell all.
        parts = [derivative(view, LegMass(joints=names, scale=1.1, down_m=k), 0.1) for k in KNOTS_M]
        shares = [np.prod([(down_m - k) / (at - k) for k in KNOTS_M if k != at]) for at in KNOTS_M]
        return np.asarray(sum(share * part for share, part in zip(shares, parts, strict=True)))[:, :, None]


class PayloadEntry(_BodyEntry):
    """A mass on the body, with its place."""

    title = "payload"
    family = "mass of the body"
    effect = PayloadMass
    coefficients = (
        Coefficient("mass_kg", "kg", -5.0, 20.0),
        Coefficient("moment_x_kg_m", "kg·m", -5.0, 5.0),
        Coefficient("moment_y_kg_m", "kg·m", -3.0, 3.0),
        Coefficient("moment_z_kg_m", "kg·m", -5.0, 5.0),
    )
    contains: ClassVar[tuple[str, ...]] = ("com_offset",)
    confused_with: ClassVar[tuple[str, ...]] = ("com_offset", "load_sensor_gain", "leg_mass")
    split_by = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One kilogram at the body's origin, and one kilogram-metre of first moment along each axis."""
        mass = derivative(view, PayloadMass(mass_kg=1.0), 1.0)
        places = np.eye(3) * 0.1
        along = [PayloadMass(mass_kg=1.0, x_m=float(x), y_m=float(y), z_m=float(z)) for x, y, z in places]
        moments = [(derivative(view, effect, 1.0) - mass) / 0.1 for effect in along]
        return np.stack([mass, *moments], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Mass, and the place that its first moments give; where hardly anything is added, a place far outside."""
        mass_kg = float(np.copysign(max(abs(coefficients[0]), 1e-9), coefficients[0]))
        return {"mass_kg": mass_kg, **dict(zip(PLACE, (coefficients[1:] / mass_kg).tolist(), strict=True))}

    def inverse(self, values: Mapping[str, float]) -> tuple[Array, Shape]:
        """Mass, and first moments of its place."""
        mass_kg = values["mass_kg"]
        return np.array([mass_kg, *(mass_kg * values[axis] for axis in PLACE)]), super().inverse(values)[1]

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """The mass and its first moments, whether or not a payload can be where they put it."""
        coefficients, _ = self.inverse(values)
        return with_mass(model, float(coefficients[0]), coefficients[1:])


def body_of(effects: Sequence[Effect]) -> tuple[float, Array]:
    """Mass of the body with all that effects put on it, kg, and its centre of mass, body frame, m, shape (3,)."""
    mass_kg, com_m = BODY.mass_kg, np.array(BODY.com_m)
    for e in effects:
        if isinstance(e, PayloadMass):
            mass_kg += e.mass_kg
            com_m = com_m + (_place_m(e) - com_m) * e.mass_kg / mass_kg
        elif isinstance(e, ComOffset):
            com_m = com_m + _place_m(e)
    return mass_kg, com_m


def _place_m(e: Effect) -> Array:
    return np.array([float(getattr(e, axis)) for axis in PLACE])


def with_mass(model: RobotModel, mass_kg: float, moment_kg_m: Array) -> RobotModel:
    """The model with more mass of the body, or less, and more of its first moments about the body's origin, shape (3,).

    What weighs more than a body is usually off by, at a place where a payload can be, is a payload. All else is the
    body's own mass, spread as it is, and a centre of mass that lies elsewhere: where nothing was strapped on, a point
    far out would add inertia that nobody saw.
    """
    before_kg, com_m = body_of(model.effects)
    wanted = before_kg * com_m + moment_kg_m
    effects = list(model.effects)
    more_kg = _bounded(effects, PayloadMass, "mass_kg", mass_kg)
    place_m = np.round(moment_kg_m / more_kg, DIGITS) if more_kg > PAYLOAD_KG else np.full(3, np.inf)
    if np.all((place_m >= PLACE_M[0]) & (place_m <= PLACE_M[1])):
        effects.append(_placed(PayloadMass(mass_kg=more_kg), place_m))
    else:
        # The body's own mass that was added before becomes more, or less.
        for i in reversed(range(len(effects))):
            e = effects[i]
            if isinstance(e, PayloadMass) and max(abs(e.mass_kg), abs(more_kg)) <= PAYLOAD_KG:
                effects[i] = replace(e, mass_kg=e.mass_kg + more_kg)
                break
        else:
            effects += [_placed(PayloadMass(mass_kg=more_kg), com_m)] if more_kg else []
    after_kg, com_m = body_of(effects)
    shift_m = [
        _bounded(effects, ComOffset, axis, float(by)) for axis, by in zip(PLACE, wanted / after_kg - com_m, strict=True)
    ]
    last = next((i for i in reversed(range(len(effects))) if isinstance(effects[i], (PayloadMass, ComOffset))), -1)
    if last >= 0 and isinstance(held := effects[last], ComOffset):
        effects[last] = _placed(held, _place_m(held) + shift_m)
    elif max(map(abs, shift_m)) > LEAST_M:
        effects.append(_placed(ComOffset(), np.array(shift_m)))
    return replace(model, effects=tuple(effects))


def _placed(e: PayloadMass | ComOffset, place_m: Array) -> Effect:
    return replace(e, **dict(zip(PLACE, place_m.tolist(), strict=True)))


def _bounded(effects: list[Effect], own: type[Effect], name: str, more: float) -> float:
    """How much more of a number the body can have beside what effects give it."""
    p = next(p for p in own.parameters() if p.name == name)
    held = sum(float(getattr(e, name)) for e in effects if isinstance(e, own))
    total = float(np.clip(held + more, p.low, p.high))
    return more if total == held + more else total - held


class ComEntry(_BodyEntry):
    """The body's centre of mass elsewhere."""

    title = "centre of mass of the body"
    family = "mass of the body"
    effect = ComOffset
    coefficients = (
        Coefficient("x_m", "m", -0.2, 0.2),
        Coefficient("y_m", "m", -0.1, 0.1),
        Coefficient("z_m", "m", -0.1, 0.1),
    )
    confused_with = ("payload_mass", "imu_tilt", "load_sensor_gain")
    split_by = MIRROR

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """A centimetre along each axis, per metre."""
        along = (ComOffset(x_m=0.01), ComOffset(y_m=0.01), ComOffset(z_m=0.01))
        return np.stack([derivative(view, effect, 0.01) for effect in along], axis=2)


class InertiaEntry(_BodyEntry):
    """The body's inertia scaled."""

    title = "rotational inertia of the body"
    family = "inertia"
    effect = BodyInertia
    coefficients = (Coefficient("scale", "1", -0.7, 2.0),)
    confused_with = ("com_offset", "payload_mass")
    split_by = MIRROR

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The moment that the inertia takes."""
        return derivative(view, BodyInertia(scale=1.1), 0.1)[:, :, None]


class SwingingMassEntry(PayloadEntry):
    """A mass on a spring, or a pendulum: a payload whose share of the body's acceleration passes a resonance.

    The body feels m·(a + g) of a mass that is fixed. One that swings at ω with damping ζ passes a on by
    (2ζω·s + ω²) / (s² + 2ζω·s + ω²): whole when slow, more at its own frequency, and none when fast. A pendulum does so
    across, a mass on a spring along the vertical too. It rings on after a start or a turn, in no phase with the stride.

    It is seen, not simulated: a simulator gets the same mass, fixed.
    """

    name = "swinging_mass"
    title = "mass that swings on the body (simulated as if fixed)"
    family = "mass of the body"
    effect = PayloadMass
    coefficients = (Coefficient("mass_kg", "kg", 0.0, 20.0), *PayloadEntry.coefficients[1:])
    least: ClassVar[Mapping[str, float]] = {"mass_kg": 0.3}
    contains = ("payload_mass", "com_offset")
    confused_with = ("payload_mass", "com_offset", "leg_mass")
    split_by = STAND
    grid: ClassVar[ShapeGrid] = {
        "frequency_hz": (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6),
        "damping": (0.05, 0.2),
        "bounces": (0.0, 1.0),
    }
    nearby: ClassVar[ShapeGrid] = {"frequency_hz": (0.85, 0.93, 1.07, 1.16), "damping": WIDE_STEPS}

    def show(self, views: Views) -> tuple[Channel, ...]:
        """Only by an inertial unit's acceleration: that of a differentiated velocity is ten times as noisy."""
        view = views.get(Channel.BASE_WRENCH)
        return super().show(views) if view is not None and view.signals.stack.imu_gravity_m_s2 is not None else ()

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """Force of one kilogram at the body's origin, and moments of one kilogram-metre along each axis."""
        s: DynamicsSignals = view.signals
        force = passed_on_m_s2(s, shape)
        none = np.zeros_like(force)
        moments = [np.concatenate([none, np.cross(axis, force)], axis=1) for axis in np.eye(3)]
        return np.stack([np.concatenate([force, none], axis=1), *moments], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Mass, place and how it swings."""
        return {**super().values(coefficients, {}), **{name: float(shape[name]) for name in SWINGS}}

    def make(self, values: Mapping[str, float], joints: tuple[str, ...]) -> Effect:
        """The same mass, fixed."""
        return PayloadMass(joints=joints, **{k: v for k, v in values.items() if k not in SWINGS})


def passed_on_m_s2(s: DynamicsSignals, shape: Shape) -> Array:
    """Force of each kilogram on the body, body frame, at the kept rows. Shape (n, 3)."""
    stack = s.stack
    if "specific_force" not in s.cache:
        raw = full_rate_inputs(stack, np.zeros(0))
        up = raw.linear_acc_in_world_m_s2 + np.array([0.0, 0.0, GRAVITY_M_S2])
        s.cache["specific_force"] = smooth(np.asarray(rotate_inverse_wxyz(raw.world_from_body_wxyz, up)))
    force = s.cache["specific_force"].copy()
    omega, axes = 2.0 * np.pi * shape["frequency_hz"], slice(0, 3 if shape["bounces"] else 2)
    damped = 2.0 * shape["damping"] * omega
    above, below = bilinear([damped, omega**2], [1.0, damped, omega**2], fs=1.0 / stack.period_s)
    at_rest = lfilter_zi(above, below)[:, None]
    force[:, axes] = stack.by_run(
        lambda part: lfilter(above, below, part, axis=0, zi=at_rest * part[:1])[0], force[:, axes]
    )
    return np.asarray(force[s.rows])
