"""What a nominal model holds beside forces: taken off the residuals by the same columns that would find it.

Channels compute what the nominal model's torques, losses, masses, feet and delay do. What its sensors, estimator,
program, link and soft ground do, they do not; without this, an effect that an earlier diagnosis put into the model
would be found again by the next one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Views
from diagnosis.library import LibraryEffect
from spot_model.effects.base import Effect, ModelEffect, TorqueEffect
from spot_model.effects.bodies import GroundCompliance
from spot_model.effects.commands import CommandDelay

IN_CHANNELS: Final = (TorqueEffect, ModelEffect, CommandDelay)
"""Kinds that channels compute by themselves, but for soft ground."""
OF_CHANNEL_ONLY: Final[Mapping[str, tuple[str, ...]]] = {
    "velocity_filter": ("square_s2", "body_share"),
    "ground_compliance": ("front_depth_m_per_n", "hind_depth_m_per_n"),
}
"""Coefficients by effect that no simulated effect has a parameter for: they stay out of a model.

They free a formula from what it cannot know, and are fitted to be left aside: what order a filter is of, and how much
of its lag reaches the body's channels; how far a foot sinks in, which in a simulator follows from the contact's time
constant.
"""


def less_held(
    views: Views, effects: Sequence[Effect], library: Mapping[str, LibraryEffect]
) -> dict[Channel, ChannelView]:
    """The channels without what those effects of the nominal model explain that channels do not compute."""
    out = dict(views)
    for effect in effects:
        entry = library.get(effect.name)
        if (
            entry is None
            or effect.is_null
            or (isinstance(effect, IN_CHANNELS) and type(effect) is not GroundCompliance)
        ):
            continue
        for name in entry.channels:
            if name in views:
                held = _held(entry, effect, views[name])
                out[name] = replace(out[name], response=out[name].response - held)
    return out


def _held(entry: LibraryEffect, effect: Effect, view: ChannelView) -> Array:
    """What an effect adds to a channel's response, shape (n, R)."""
    added = np.zeros_like(view.response)
    for joints, values in groups_of(effect):
        coefficients, shape = entry.inverse(values)
        added += entry.columns(view, shape, joints) @ coefficients
    return added


def groups_of(effect: Effect) -> list[tuple[Flags, dict[str, float]]]:
    """Joints of an effect that have the same values, shape (12,), with the values by parameter."""
    columns = {name: np.broadcast_to(value, (1, len(effect.mask)))[0] for name, value in effect.values.items()}
    rows = list(zip(*columns.values(), strict=True))
    found = []
    for row in sorted({rows[j] for j in np.flatnonzero(effect.mask)}):
        joints = effect.mask & np.array([own == row for own in rows])
        found.append((joints, dict(zip(columns, map(float, row), strict=True))))
    return found
