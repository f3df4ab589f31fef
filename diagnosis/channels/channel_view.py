"""What the parts of the diagnosis hand to each other: one channel over all logs, and what an effect predicts in it.

A channel turns logs and the nominal model into a :class:`ChannelView`: a response that is zero, up to noise, where the
nominal model is the truth. An effect predicts the response as columns times coefficients; a coefficient is a parameter
less its null value. Numbers that do not enter linearly are the effect's *shape*, tried value by value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.channel import Channel

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Flags = NDArray[np.bool_]
Rows = slice | Flags
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
    ``thinned(every)``, signals of one of so many samples, and these samples, where a long log needs no more."""
    is_measured: bool = True
    """Whether the response tells anything; where something stands in for a signal that logs lack, it does not."""
    is_robust: bool = True
    """Whether a fit holds outliers down; where rare samples are the effect itself (losses, noise), it must not."""
    notes: tuple[str, ...] = ()
    """What a reader should know, a sentence each."""

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.run)

    def of_rows(self, signals: Any, rows: Rows) -> ChannelView:
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
