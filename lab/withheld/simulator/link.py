"""How long states take to the program and commands to the servos, and when the program runs its policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import STATE_PERIOD_NS, Array
from withheld.simulator.parameters import LinkParameters
from withheld.simulator.robot import DelayPart

UP_SHAPE, DOWN_SHAPE = 3.0, 1.7
TICK_NS = 20_000_000
DIVIDER = 6
NEVER_NS = np.iinfo(np.int64).max // 4

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Deliveries:
    """Commands of one run: number k answers state k. Times count from state 0, ns; shape (n_states,)."""

    up_ns: Ints
    """From the state's stamp to its receipt."""
    sent_ns: Ints
    is_sent: NDArray[np.bool_]
    """Whether that state was answered at all."""
    arrival_ns: Ints
    """At the servos; a large number for a command that was lost or never sent."""

    def newest(self, now_ns: Ints) -> NDArray[np.intp]:
        """The command in effect at each of some rising instants, -1 before the first."""
        arrived = np.flatnonzero(self.arrival_ns < NEVER_NS)
        place = np.searchsorted(self.arrival_ns[arrived], now_ns, side="right") - 1
        return np.where(place >= 0, arrived[np.maximum(place, 0)], -1).astype(np.intp)


def mean_delay_s(link: LinkParameters) -> float:
    """From state to command in effect, on average: what the nominal model knows."""
    up = link.up_floor_s + UP_SHAPE * link.up_scale_s
    return up + link.compute_s + link.down_floor_s + DOWN_SHAPE * link.down_scale_s


def tick_states(n_states: int, link: LinkParameters, rng: np.random.Generator) -> NDArray[np.intp]:
    """States at which the policy runs; a slipped tick runs one state late and the next one on schedule."""
    if link.schedule == "timer":
        due_ns = TICK_NS * np.arange(n_states * STATE_PERIOD_NS // TICK_NS + 1)
        on_time = -(-due_ns // STATE_PERIOD_NS)
    else:
        on_time = np.arange(0, n_states, DIVIDER)
    late = rng.random(len(on_time)) < link.slipped_share
    late[0] = False
    at = on_time + late
    return np.asarray(at[at < n_states], dtype=np.intp)


def deliveries(
    n_states: int, link: LinkParameters, ticks: NDArray[np.intp], parts: Sequence[DelayPart], rng: np.random.Generator
) -> Deliveries:
    """Draw a run's transport."""
    up = link.up_floor_s + link.up_scale_s * rng.standard_gamma(UP_SHAPE, n_states)
    down = link.down_floor_s + link.down_scale_s * rng.standard_gamma(DOWN_SHAPE, n_states)
    extra: Array = np.zeros(n_states)
    # Each part draws from a generator of its own: one more of them changes no other draw of the run.
    for part, own in zip(parts, rng.spawn(len(parts)), strict=True):
        extra = extra + part(n_states, own)
    is_sent = np.ones(n_states, dtype=np.bool_)
    if link.schedule == "divider":
        is_sent = np.isin(np.arange(n_states), ticks)
    up_ns = _ns(up)
    sent_ns = STATE_PERIOD_NS * np.arange(n_states, dtype=np.int64) + up_ns + round(link.compute_s * 1e9)
    kept = np.isfinite(extra) & is_sent
    arrival = np.full(n_states, NEVER_NS, dtype=np.int64)
    # A gRPC stream keeps its order.
    arrival[kept] = np.maximum.accumulate((sent_ns + _ns(down + np.where(kept, extra, 0.0)))[kept])
    return Deliveries(up_ns, sent_ns, is_sent, arrival)


def _ns(seconds: Array) -> Ints:
    return np.round(seconds * 1e9).astype(np.int64)
