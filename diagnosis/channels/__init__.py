"""Residual channels: ways to look at logs in which the nominal model predicts zero up to noise.

A channel turns logs and the nominal model into a :class:`ChannelView`: a response that is zero, up to noise, where the
nominal model is the truth. An effect predicts the response as columns times coefficients; a coefficient is a parameter
less its null value. Numbers that do not enter linearly are the effect's *shape*, tried value by value.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray


class Channel(enum.StrEnum):
    """Channels in the order in which they are looked at; the value is the name in files."""

    POLICY_REPLAY = "policy_replay"
    TIME_STAMPS = "time_stamps"
    SENSOR_NOISE = "sensor_noise"
    JOINT_RATES = "joint_rates"
    SET_POINT_TO_LOAD = "set_point_to_load"
    LOAD_TO_MOTION = "load_to_motion"
    BASE_WRENCH = "base_wrench"
    CONTACT_EVENTS = "contact_events"
    STANCE_KINEMATICS = "stance_kinematics"
    INERTIAL_UNIT = "inertial_unit"
    BATTERY_POWER = "battery_power"


CHANNEL_TITLES: Final[Mapping[str, str]] = {
    Channel.POLICY_REPLAY: "policy replay",
    Channel.TIME_STAMPS: "time stamps of commands",
    Channel.SENSOR_NOISE: "noise of the joint sensors",
    Channel.JOINT_RATES: "joint velocities against positions",
    Channel.SET_POINT_TO_LOAD: "set-point to load",
    Channel.LOAD_TO_MOTION: "load to motion of swinging legs",
    Channel.BASE_WRENCH: "base motion against the loads of all legs",
    Channel.CONTACT_EVENTS: "contact flags and slips against the legs' forces",
    Channel.STANCE_KINEMATICS: "kinematics of standing feet",
    Channel.INERTIAL_UNIT: "inertial unit against the estimator",
    Channel.BATTERY_POWER: "battery power and voltage",
}
"""For a person; by the name that a file holds."""

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]
SampleRows = slice | Flags
"""Some samples."""

Shape = Mapping[str, float]
"""Values of the parameters that do not enter linearly, by name; empty where there are none."""


@dataclass(frozen=True)
class ChannelOff:
    """A channel that these logs cannot feed."""

    name: Channel
    reason: str


@dataclass(frozen=True)
class ChannelView:
    """One channel over all recordings, stacked: n samples of R rows.

    A row is one scalar signal: a joint, a component of the base's force or moment, a foot's component.
    """

    name: Channel
    rows: tuple[str, ...]
    """Names of the R rows."""
    unit: str
    response: Array
    """Measured less predicted by the nominal model. Shape (n, R)."""
    usable: Flags
    """Where the response means something. Shape (n, R)."""
    run: Ints
    """Number of the recording that a sample comes from. Shape (n,)."""
    state: Ints
    """Row of that recording's states at the sample. Shape (n,)."""
    noise: Array
    """Standard deviation of a usable sample that sensor noise alone explains. Shape (R,), > 0."""
    nuisance: Array
    """What is always fitted beside any effect, each row by itself. Shape (n, R, q)."""
    row_joint: Ints
    """Joint that a row belongs to, -1 for none. Shape (R,)."""
    row_leg: Ints
    """Leg that a row belongs to, -1 for none. Shape (R,)."""
    leg_of_joint: Ints
    """Leg of each joint of the robot, -1 for none. Shape (J,)."""
    signals: Any
    """What effects compute their columns from, most often a class of the channel's own file; with a method
    ``thinned(apart)``, signals of samples so many states apart, and these samples, where a long log needs no more."""
    is_measured: bool = True
    """Whether the response tells anything; where something stands in for a signal that logs lack, it does not."""
    is_robust: bool = True
    """Whether a fit holds outliers down; where rare samples are the effect itself (losses, noise), it must not."""
    notes: tuple[str, ...] = ()
    """What a reader should know, a sentence each."""

    def unit_of(self, row: int) -> str:
        """Unit of one row: a channel of several has them in the order in which its rows' quantities first stand."""
        units = self.unit.split(", ")
        if len(units) == 1:
            return self.unit
        quantities = [next(word for word in name.split("_") if len(word) > 2) for name in self.rows]
        return dict(zip(dict.fromkeys(quantities), units, strict=True))[quantities[row]]

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.run)

    def of_rows(self, signals: Any, rows: SampleRows) -> ChannelView:
        """Some samples, with the signals that belong to them."""
        return replace(
            self,
            response=self.response[rows],
            usable=self.usable[rows],
            run=self.run[rows],
            state=self.state[rows],
            nuisance=self.nuisance[rows],
            signals=signals,
        )

    def of_run(self, run: int) -> Flags:
        """Samples of one recording, shape (n,)."""
        return np.asarray(self.run == run)


Views = Mapping[Channel, ChannelView]
"""The channels that are on, by name."""


MAX_SAMPLES: Final = 6_000
"""About this many samples of each channel are used, evenly thinned."""


def thinned_views(views: Mapping[Channel, ChannelView], n_states: int) -> dict[Channel, ChannelView]:
    """The channels with one of so many rows that about :data:`MAX_SAMPLES` are left; short ones as they are."""
    apart = n_states // MAX_SAMPLES
    # Channels of the body share their signals, and what is kept with them.
    made: dict[int, tuple[Any, SampleRows]] = {}

    def of(view: ChannelView) -> ChannelView:
        if not hasattr(view.signals, "thinned"):
            return view
        if id(view.signals) not in made:
            made[id(view.signals)] = view.signals.thinned(apart)
        return view.of_rows(*made[id(view.signals)])

    return {name: of(view) for name, view in views.items()}
