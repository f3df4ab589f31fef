"""Effects of the drive in logs without loads: the servo law stands in for a load, and the motion tells what it gave."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals, wrench_of_joints
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape, Views
from diagnosis.library.base import LibraryEffect

MOTION: Final = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)


def drive_of(view: ChannelView | None) -> ChannelView | None:
    """What stands in for the loads of a channel of the body; None where they were measured."""
    return view.signals.drive if view is not None and isinstance(view.signals, DynamicsSignals) else None


def with_stand_in(views: Views) -> Views:
    """The channels, and beside them what stands in for *set-point to load*, from which effects take their columns."""
    drive = next((d for name in MOTION if (d := drive_of(views.get(name))) is not None), None)
    return views if drive is None else {**views, Channel.SET_POINT_TO_LOAD: drive}


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
