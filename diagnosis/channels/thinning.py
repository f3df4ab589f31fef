"""Long logs, of which every so many rows are enough: an effect's columns cost as much as their rows, and tell no more.

Noise and conventions of time are found from all rows before.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import ChannelView, Rows

MAX_SAMPLES: Final = 6_000
"""Of each channel's samples about so many are used, evenly thinned."""
LONG: Final = 4 * MAX_SAMPLES
"""States from which on channels are thinned; those of the body keep one of four."""


def thinned(views: Mapping[Channel, ChannelView], n_states: int) -> dict[Channel, ChannelView]:
    """The channels with one of so many rows that about :data:`MAX_SAMPLES` are left; short ones as they are."""
    every = n_states // LONG
    if every < 2:
        return dict(views)
    # Channels of the body share their signals, and what is kept with them.
    made: dict[int, tuple[Any, Rows]] = {}

    def of(view: ChannelView) -> ChannelView:
        if not hasattr(view.signals, "thinned"):
            return view
        if id(view.signals) not in made:
            made[id(view.signals)] = view.signals.thinned(every)
        return view.of_rows(*made[id(view.signals)])

    return {name: of(view) for name, view in views.items()}
