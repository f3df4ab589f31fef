"""How long commands take from the state that they answer to the servos; one command a state, in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import STATE_PERIOD_NS, Array
from withheld.realities.hooks import DelayPart

UP_FLOOR_S, UP_SHAPE, UP_SCALE_S = 1.1e-3, 3.0, 0.6e-4
"""State to host: a floor and a gamma distribution."""
COMPUTE_S = 2.6e-4
DOWN_FLOOR_S, DOWN_SHAPE, DOWN_SCALE_S = 2.5e-3, 4.0, 1.4e-4
MEAN_DELAY_S = UP_FLOOR_S + UP_SHAPE * UP_SCALE_S + COMPUTE_S + DOWN_FLOOR_S + DOWN_SHAPE * DOWN_SCALE_S
"""What the nominal model knows of it."""
NEVER_NS = np.iinfo(np.int64).max // 4

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Deliveries:
    """Commands of one run: number k answers state k. Times count from state 0, ns; shape (n_states,)."""

    up_ns: Ints
    """From the state's stamp to its receipt."""
    sent_ns: Ints
    arrival_ns: Ints
    """At the servos; a large number for a lost command."""

    def newest(self, now_ns: Ints) -> NDArray[np.intp]:
        """The command in effect at each of some rising instants, -1 before the first."""
        arrived = np.flatnonzero(self.arrival_ns < NEVER_NS)
        place = np.searchsorted(self.arrival_ns[arrived], now_ns, side="right") - 1
        return np.where(place >= 0, arrived[np.maximum(place, 0)], -1).astype(np.intp)


def deliveries(n_states: int, parts: Sequence[DelayPart], rng: np.random.Generator) -> Deliveries:
    """Draw a run's transport."""
    up = UP_FLOOR_S + UP_SCALE_S * rng.standard_gamma(UP_SHAPE, n_states)
    down = DOWN_FLOOR_S + DOWN_SCALE_S * rng.standard_gamma(DOWN_SHAPE, n_states)
    extra: Array = np.zeros(n_states)
    # Each part draws from a generator of its own: one more of them moves no other draw of the run.
    for part, own in zip(parts, rng.spawn(len(parts)), strict=True):
        extra = extra + part.extra_s(n_states, own)
    stamp_ns = STATE_PERIOD_NS * np.arange(n_states, dtype=np.int64)
    up_ns = _ns(up)
    sent_ns = stamp_ns + up_ns + round(COMPUTE_S * 1e9)
    kept = np.isfinite(extra)
    arrival = np.full(n_states, NEVER_NS, dtype=np.int64)
    arrival[kept] = np.maximum.accumulate((sent_ns + _ns(down + np.where(kept, extra, 0.0)))[kept])
    return Deliveries(up_ns, sent_ns, arrival)


def _ns(seconds: Array) -> Ints:
    return np.round(seconds * 1e9).astype(np.int64)
