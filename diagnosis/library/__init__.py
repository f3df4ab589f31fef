"""What the diagnosis knows of one effect: where it shows, what it looks like, what it is mistaken for."""

from __future__ import annotations

import enum
import itertools
from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints, Shape, Views
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.channels.dynamics import DynamicsSignals, wrench_of_joints
from diagnosis.library.experiments import SPRINT, Experiment
from diagnosis.library.less import with_less
from spot_model.effects.base import Effect, TorqueEffect
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import describe_joints, select_joints


class Location(enum.Enum):
    """What an effect can be local to."""

    JOINT = "joint"
    """Each joint by itself, or any set of joints."""
    LEG = "leg"
    """Each leg by itself, or any set of legs."""
    ROBOT = "robot"
    """The robot as a whole only."""


@dataclass(frozen=True)
class Coefficient:
    """One linear unknown: what a column is multiplied by."""

    name: str
    unit: str
    low: float
    high: float
    """Bounds of the coefficient (parameter less null). Equal bounds: the column has no freedom but its shape."""

    @property
    def is_free(self) -> bool:
        """Whether the column's size is to be found."""
        return self.low != self.high


ShapeGrid = Mapping[str, tuple[float, ...]]
STEPS: Final = (0.72, 0.85, 0.93, 1.08, 1.18, 1.38)
WIDE_STEPS: Final = (0.72, 0.85, 1.19, 1.4)
CLOSE_STEPS: Final = (0.9, 0.94, 0.97, 1.03, 1.06, 1.1)
"""Factors from a shape to its neighbours."""
ALL_OF_IT: Final = Coefficient("share", "1", 1.0, 1.0)
"""The coefficient of an effect whose size is in its shape."""


class LibraryEffect(ABC):
    """One effect of the library.

    An entry of a torque effect, or of a model effect that changes friction, damping or rotor inertia of the joints,
    needs no formula: its columns are the effect's own, evaluated on the logged motion, and its coefficients are named
    after the effect's parameters.

    ``columns`` of a joint set is the sum over its joints, so that one coefficient is shared by the set. In a channel
    of ``separable``, joint j touches row j alone; there the columns of one joint are those of all joints, row j.
    """

    name: ClassVar[str]
    """Name of the spot_model effect, unless another is given."""
    title: ClassVar[str]
    """For a person; the name in words, unless it is given."""
    family: ClassVar[str] = ""
    """What it has in common with effects like it, for a person; empty where there are none."""
    effect: ClassVar[type[Effect]]
    """What puts it into a simulator."""
    channels: ClassVar[tuple[Channel, ...]] = (Channel.SET_POINT_TO_LOAD,)
    """Where it shows; a missing channel makes it weaker, missing all makes it invisible."""
    separable: ClassVar[frozenset[Channel]] = frozenset(
        {Channel.SET_POINT_TO_LOAD, Channel.JOINT_RATES, Channel.POLICY_REPLAY}
    )
    of_load_cell: ClassVar[bool] = False
    """It changes what is measured of a load, and nothing else."""
    is_quick: ClassVar[bool] = False
    """It comes and goes within milliseconds: states far apart do not show it."""
    location: ClassVar[Location] = Location.JOINT
    singly: ClassVar[bool] = False
    """Each unit has its own size by nature, so that several of one size are no fault but a coincidence."""
    coefficients: ClassVar[tuple[Coefficient, ...]]
    least: ClassVar[Mapping[str, float]] = {}
    """Parameters by name, and the size under which the effect is not there, whatever its other columns explain."""
    largest: ClassVar[Mapping[str, float]] = {}
    """Largest realistic size of coefficients, by name, where that is no multiple of ordinary errors."""
    contains: ClassVar[tuple[str, ...]] = ()
    """Names of effects that this one can be, with some of its numbers at zero: they are not looked for beside it."""
    confused_with: ClassVar[tuple[str, ...]] = ()
    """Names of library effects that can look the same."""
    split_by: ClassVar[Experiment] = SPRINT
    """What to record to tell it from those."""

    grid: ClassVar[ShapeGrid] = {}
    """Values of the shape's numbers that are tried first, each with each."""
    nearby: ClassVar[ShapeGrid] = {}
    """Factors by which the shape's numbers are moved in a finer round, one at a time."""

    taken_away: Mapping[str, float] = {}
    """Parameters by name of which a nominal model's own may be less, and by how much at most, below 0."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "effect" in vars(cls):
            cls.name = vars(cls).get("name", cls.effect.name)
            cls.title = vars(cls).get("title", cls.name.replace("_", " "))

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """Values of the non-linear parameters that are worth a try, coarse, from the data of the joints.

        Default: :attr:`grid`; without one an empty shape, since all is linear.
        """
        return tuple(dict(zip(self.grid, at, strict=True)) for at in itertools.product(*self.grid.values()))

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """Shapes near one, for a finer round; parameters may leave their bounds here. Default: :attr:`nearby`."""
        return tuple({**shape, name: shape[name] * f} for name, fs in self.nearby.items() if shape[name] for f in fs)

    def refined(self, shape: Shape) -> tuple[Shape, ...]:
        """Neighbours of the best shape that keep the bounds of the simulator's parameters."""
        bounds = {p.name: (p.low, p.high) for p in self.effect.parameters()}

        def allowed(shape: Shape) -> bool:
            return all(low <= shape[name] <= high for name, (low, high) in bounds.items() if name in shape)

        return tuple(s for s in self.neighbours(shape) if allowed(s))

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What one unit of each coefficient adds to the response. Shape (n, R, len(coefficients)).

        Default: the slope of the effect's own formula over the logged motion.
        """
        return on_joints(effect_columns(self, view.signals, shape), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Parameters of the spot_model effect, from coefficients of shape (len(coefficients),) and the shape.

        Default: a coefficient named after a parameter is its difference from the null value; the rest is the shape's.
        What lies beyond a parameter's bounds is put at the bound.
        """
        known = {p.name: p for p in self.effect.parameters()}
        found = {name: float(value) for name, value in shape.items() if name in known}
        for c, value in zip(self.coefficients, coefficients, strict=True):
            if c.is_free and c.name in known:
                found[c.name] = known[c.name].null + float(value)
        least = {name: p.low for name, p in known.items()} | dict(self.taken_away)
        return {name: min(max(value, least[name]), known[name].high) for name, value in found.items()}

    def inverse(self, values: Mapping[str, float]) -> tuple[Array, Shape]:
        """Coefficients and shape of an effect with these parameters: what :meth:`values` came from.

        Default: a parameter less its null value; of what is no parameter, nothing, and the grid's first shape.
        """
        null = {p.name: p.null for p in self.effect.parameters()}
        size = [values[c.name] - null[c.name] if c.name in values else 0.0 for c in self.coefficients]
        fixed = [c.high if not c.is_free else own for c, own in zip(self.coefficients, size, strict=True)]
        return np.array(fixed), {name: values.get(name, tried[0]) for name, tried in self.grid.items()}

    def is_there(self, coefficients: Array, shape: Shape) -> bool:
        """Whether all parameters of :attr:`least` are large enough."""
        values = self.values(coefficients, shape)
        return all(abs(values[name]) >= size for name, size in self.least.items())

    def make(self, values: Mapping[str, float], joints: tuple[str, ...]) -> Effect:
        """The spot_model effect with these parameters."""
        return self.effect(joints=joints, **values)

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """The nominal model with the effect. Default: added at the end; a correction of what is there replaces it.

        A size below what the effect can have takes away from the model's own.
        """
        p = next((p for p in self.effect.parameters() if values.get(p.name, p.low) < p.low), None)
        if p is not None:
            return with_less(model, self.effect, p, np.where(select_joints(joints), values[p.name] - p.null, 0.0))
        return model.with_effects(self.make(values, joints))

    def show(self, views: Views) -> tuple[Channel, ...]:
        """Channels in which the effect can be seen in these logs."""
        drive = views.get(Channel.SET_POINT_TO_LOAD)
        if self.of_load_cell and (drive is None or not drive.is_measured):
            return ()
        return tuple(c for c in self.channels if c in views)


def acts_last(effect: LibraryEffect) -> bool:
    """Whether it comes into a model after those of the whole robot, which go by the joints of the nominal model."""
    return effect.location is not Location.ROBOT


def legs_with(joints: Flags, view: ChannelView) -> Flags:
    """Legs with any of the joints, shape (number of legs,); at least one entry."""
    return np.isin(np.arange(max(1, int(view.leg_of_joint.max(initial=-1)) + 1)), view.leg_of_joint[joints])


def on_joints(values: Array, joints: Flags) -> Array:
    """Columns (n, J) or (n, J, k) restricted to some joints, as (n, J, k)."""
    return np.asarray((values if values.ndim == 3 else values[:, :, None]) * joints[:, None])


def constant_columns(view: ChannelView, *columns: NDArray[np.floating[Any]]) -> Array:
    """Columns that are the same at every sample, each given by row, shape (R,); shape (n, R, number of columns)."""
    return np.tile(np.stack(columns, axis=1), (view.n, 1, 1))


@dataclass(frozen=True)
class JointGroups:
    """Joints of the robot, in groups."""

    joint_names: tuple[str, ...]
    leg_of_joint: Ints
    """Shape (J,), -1 for none."""

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def types(self) -> dict[str, Flags]:
        """Joints by what stands after the last underscore of their names, `_joint` apart; each shape (J,)."""
        ends = [name.removesuffix("_joint").rsplit("_", 1)[-1] for name in self.joint_names]
        return {end: np.array([e == end for e in ends]) for end in dict.fromkeys(ends)}

    def units(self, location: Location) -> Array:
        """Joints of each unit, shape (U, J), 0 or 1."""
        if location is Location.ROBOT:
            return np.ones((1, self.n_joints))
        if location is Location.LEG:
            legs = [leg for leg in np.unique(self.leg_of_joint) if leg >= 0]
            if legs:
                return np.array([(self.leg_of_joint == leg).astype(np.float64) for leg in legs])
            return np.ones((1, self.n_joints))
        return np.eye(self.n_joints)

    def places(self, effect: LibraryEffect) -> Array:
        """Sets of units that are tried first, shape (L, U), 0 or 1, each once."""
        units = self.units(effect.location)
        n = len(units)
        if effect.location is Location.ROBOT:
            return np.ones((1, 1))
        if effect.singly:
            return np.eye(n)
        sets = [np.ones(n), *np.eye(n)]
        if effect.location is Location.JOINT:
            types = list(self.types().values())
            sets += [t.astype(np.float64) for t in types]
            sets += [(types[i] | types[j]).astype(np.float64) for i in range(len(types)) for j in range(i)]
            sets += list(self.units(Location.LEG)) if self.leg_of_joint.max(initial=-1) >= 0 else []
            legs = self.leg_of_joint
            sets += [(t & np.isin(legs, pair)).astype(np.float64) for t in types for pair in PAIRS]
        sets += [np.isin(np.arange(n), pair).astype(np.float64) for pair in PAIRS] if n == N_LEGS else []
        return np.unique(np.array([s for s in sets if s.any()]), axis=0)

    def joints_of(self, effect: LibraryEffect, place: Array) -> Flags:
        """Joints of a set of units, shape (J,)."""
        return np.asarray(place @ self.units(effect.location) > 0.5)

    def words_for(self, effect: LibraryEffect, place: Array) -> tuple[str, ...]:
        """Joints of a set of units as a model file names them."""
        mask = self.joints_of(effect, place)
        return describe_joints(mask) if self.joint_names == JOINT_NAMES else self.named(mask)

    def named(self, joints: Flags) -> tuple[str, ...]:
        """Names of joints."""
        return tuple(name for name, there in zip(self.joint_names, joints, strict=True) if there)


N_LEGS = 4
PAIRS: Sequence[tuple[int, int]] = ((0, 1), (2, 3), (0, 2), (1, 3))
"""Front, hind, left and right legs, where there are four in the canonical order."""


SLOPE_SHARE: Final = 0.01
"""Slopes are taken over this share of a coefficient's range."""


def effect_columns(entry: LibraryEffect, s: ActuatorSignals, shape: Shape) -> Array:
    """Slope of what the entry's effect adds to every joint's load, by coefficient; shape (n, J, len(coefficients)).

    A coefficient without freedom gives all that the effect adds.
    """

    def added(coefficients: Array) -> Array:
        effect = entry.effect(joints=("all",), **entry.values(coefficients, shape))
        if isinstance(effect, TorqueEffect):
            return s.added_nm(effect)
        return -s.losses_nm(effect)

    at = np.array([0.0 if c.is_free else c.high for c in entry.coefficients])
    before, found = added(at), []
    for k, c in enumerate(entry.coefficients):
        step = SLOPE_SHARE * (c.high if c.high > 0.0 else c.low)
        found.append((added(at + step * (np.arange(len(at)) == k)) - before) / step if c.is_free else before)
    return np.stack(found, axis=2)


MOTION: Final = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)


def drive_of(view: ChannelView | None) -> ChannelView | None:
    """What stands in for the loads of a channel of the body; None where they were measured."""
    return view.signals.drive if view is not None and isinstance(view.signals, DynamicsSignals) else None


def with_stand_in(views: Views) -> Views:
    """The channels, and beside them what stands in for *set-point to load*, from which effects take their columns."""
    drive = next((d for name in MOTION if (d := drive_of(views.get(name))) is not None), None)
    return views if drive is None else {**views, Channel.SET_POINT_TO_LOAD: drive}


def lacks_loads(effect: LibraryEffect, views: Views) -> bool:
    """Whether an effect changes loads that no log has: it shows in the motion alone, beside what is moved.

    There it is gain · (what the servo asks for) − (what the drive takes) = mass · acceleration + weight: each number is
    seen relative to all others, at any gains of the servo.
    """
    drive = views.get(Channel.SET_POINT_TO_LOAD)
    return Channel.SET_POINT_TO_LOAD in effect.channels and drive is not None and not drive.is_measured


class ThroughMotion:
    """What an effect of the drive adds to a channel of the body.

    Loads are taken to be what the nominal drive gives. What the effect adds to the true ones is missing in them.
    """

    def __init__(self, effect: LibraryEffect, shape: Shape, view: ChannelView) -> None:
        signals: DynamicsSignals = view.signals
        if signals.drive is None:
            raise ValueError(f"channel {view.name} has measured loads")
        self._effect, self._shape, self._drive = effect, shape, signals.drive
        self._rows = signals.rows // signals.drive.signals.stride
        self._wrench = wrench_of_joints(signals) if view.name == Channel.BASE_WRENCH else None
        every = np.ones(len(signals.drive.rows), dtype=np.bool_)
        self._whole = self._drives(every) if Channel.SET_POINT_TO_LOAD in effect.separable else None

    def columns(self, joints: Flags) -> Array:
        """Shape (n, R, coefficients)."""
        added = self._drives(joints) if self._whole is None else self._whole * joints[:, None]
        return -added if self._wrench is None else -np.einsum("njk,njr->nrk", added, self._wrench)

    def _drives(self, joints: Flags) -> Array:
        return np.asarray(self._effect.columns(self._drive, self._shape, joints)[self._rows])
