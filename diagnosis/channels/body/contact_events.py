"""Channel *contact events*: contact flags and slips against the forces that the legs' loads say the feet carry.

Rows, leg by leg: how late a flag changes after the force does, s, one sample a touch-down or lift-off; the friction
coefficient at which a foot slips less the nominal model's, one sample a slipping state; and how long the ground takes
to stop a foot, s, less the nominal model's time, one sample a touch-down.
Time convention: a force counts as changed when it crosses a threshold; smoothing is symmetrical in time; a foot's stop
is timed by its own velocity alone, so that a late flag shifts nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.body.body_model import BodyModel
from diagnosis.channels.body.dynamics import DynamicsSignals
from diagnosis.channels.body.stance import StanceSignals, feet
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from spot_model.effects.base import Effect
from spot_model.robot import facts
from spot_model.robot.mjcf_options import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz

ROWS: Final = (
    *(f"{leg}_flag" for leg in facts.LEG_NAMES),
    *(f"{leg}_slip" for leg in facts.LEG_NAMES),
    *(f"{leg}_stop" for leg in facts.LEG_NAMES),
)
SEARCH: Final = 30
"""States on either side of a flag's change in which the force's crossing is looked for."""
THRESHOLD_SHARE: Final = 0.25
"""A force counts as contact above this share of its level in the stance beside it."""
MIN_LEVEL_N: Final = 30.0
SLIP_M_S: Final = 0.3
NEAR_LIMIT: Final = 0.75
"""A foot slips for want of grip only where its ratio of forces is near the largest that ever occurs."""
LARGEST_QUANTILE: Final = 0.97
SLIP_NORMAL_N: Final = 25.0
STOP_AROUND: Final = 8
STOP_LAST: Final = 35
"""States around a touch-down's flag in which a foot is fastest, and after it in which it has to be stopped."""
STOP_M_S: Final = 0.3
"""A foot must come down at least this fast to be stopped measurably."""
STOP_FROM: Final = 0.75
STOP_TO: Final = 0.25
"""The shares of its largest downward speed between which a stop is timed.

Not until it rests: a foot that rolls, under a body that still leans, goes on down at 0.05 m/s for 80 ms.
"""
STOP_PER_TIME_CONSTANT: Final = 0.425
"""Of a critically damped contact; in trials of the nominal simulator 0.42 to 0.45, from 20 to 44 ms."""
NOMINAL_STOP_S: Final = STOP_PER_TIME_CONSTANT * MjcfOptions().contact_solref[0]
STOP_FLOOR_S: Final = 1.5e-3
FLAG_BIAS_S: Final = 6e-3
"""A smoothed force rises this much before the flag of a contact does; in trials 5 to 7 ms."""
FLAG_FLOOR_S: Final = 6e-3
SLIP_FLOOR: Final = 0.05


@dataclass(frozen=True)
class ContactSignals:
    """Signals of channel *contact events*."""

    friction: Array
    """Nominal coefficient of each foot, shape (4,)."""


def contact_view(
    dynamics: DynamicsSignals, stance: StanceSignals, effects: Sequence[Effect]
) -> ChannelView | ChannelOff:
    """Build the channel *contact events*."""
    if not dynamics.has_flags:
        return ChannelOff(Channel.CONTACT_EVENTS, "no contact flags")
    stack = dynamics.stack
    normal = vertical_force_n(dynamics)
    rows, legs, late = _flag_delays(dynamics, normal)
    friction = BodyModel(effects).foot_friction
    slip_rows, slip_legs, ratios = _slips(dynamics, stance)
    stop_rows, stop_legs, stop_s = _stop_times(stance)
    n_flags, n_slips, n_stops = len(rows), len(slip_rows), len(stop_rows)
    n = n_flags + n_slips + n_stops
    if n == 0:
        return ChannelOff(Channel.CONTACT_EVENTS, "no foot ever lifts off or touches down")
    response = np.zeros((n, len(ROWS)))
    usable = np.zeros(response.shape, dtype=np.bool_)
    response[np.arange(n_flags), legs] = late
    usable[np.arange(n_flags), legs] = True
    at = n_flags + np.arange(n_slips)
    response[at, facts.N_LEGS + slip_legs] = ratios - friction[slip_legs]
    usable[at, facts.N_LEGS + slip_legs] = True
    at = n_flags + n_slips + np.arange(n_stops)
    response[at, 2 * facts.N_LEGS + stop_legs] = stop_s - NOMINAL_STOP_S
    usable[at, 2 * facts.N_LEGS + stop_legs] = True
    every = np.concatenate([rows, slip_rows, stop_rows])
    numbers = np.arange(facts.N_LEGS, dtype=np.intp)
    return ChannelView(
        name=Channel.CONTACT_EVENTS,
        rows=ROWS,
        unit="s, 1, s",
        response=response,
        usable=usable,
        run=stack.run[every],
        state=stack.state[every],
        noise=np.repeat([FLAG_FLOOR_S, SLIP_FLOOR, STOP_FLOOR_S], facts.N_LEGS),
        nuisance=np.zeros((*response.shape, 0)),
        row_joint=np.full(len(ROWS), -1, dtype=np.intp),
        row_leg=np.tile(numbers, 3),
        leg_of_joint=np.repeat(numbers, 3),
        signals=ContactSignals(friction),
        measured={"slipping_samples": float(n_slips)},
    )


def vertical_force_n(dynamics: DynamicsSignals) -> Array:
    """Vertical force on each foot at the full rate, interpolated between the kept rows; shape (N, 4)."""
    force = rotate_wxyz(dynamics.inputs.world_from_body_wxyz[:, None, :], dynamics.nominal.foot_force_n)[..., 2]
    every = np.arange(dynamics.stack.n)
    return np.stack([np.interp(every, dynamics.rows, force[:, leg]) for leg in range(facts.N_LEGS)], axis=1)


def _flag_delays(dynamics: DynamicsSignals, normal_n: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Row, leg and lateness (s) of each change of a flag that has a clear crossing of the force beside it."""
    stack = dynamics.stack
    contact = stack.cat(lambda r: r.foot_contact).astype(np.bool_)
    usable = stack.inner(stack.used, SEARCH, SEARCH)
    rows, legs, late = [], [], []
    for leg in range(facts.N_LEGS):
        changes = np.flatnonzero(np.diff(contact[:, leg].astype(np.int8))) + 1
        for row in changes[usable[changes]]:
            touches = bool(contact[row, leg])
            window = normal_n[row - SEARCH : row + SEARCH, leg]
            level = float(np.max(window[SEARCH:] if touches else window[:SEARCH]))
            if level < MIN_LEVEL_N:
                continue
            above = window > THRESHOLD_SHARE * level
            crossings = np.flatnonzero(np.diff(above.astype(np.int8)) == (1 if touches else -1))
            if len(crossings) != 1:
                continue
            k = int(crossings[0])
            share = (THRESHOLD_SHARE * level - window[k]) / (window[k + 1] - window[k])
            rows.append(int(row))
            legs.append(leg)
            late.append((SEARCH - (k + share)) * stack.period_s - FLAG_BIAS_S)
    return (
        np.array(rows, dtype=np.intp),
        np.array(legs, dtype=np.intp),
        np.array(late, dtype=np.float64),
    )


def _slips(dynamics: DynamicsSignals, stance: StanceSignals) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Row, leg and ratio of shear to normal force of each state in which a loaded foot slips."""
    force = rotate_wxyz(dynamics.inputs.world_from_body_wxyz[:, None, :], dynamics.nominal.foot_force_n)
    normal, shear = force[..., 2], np.hypot(force[..., 0], force[..., 1])
    velocity = stance.nominal[:, : 3 * facts.N_LEGS].reshape(-1, facts.N_LEGS, 3)
    sliding = np.hypot(velocity[..., 0], velocity[..., 1]) > SLIP_M_S
    steady = stance.stack.inner(stance.stack.cat(lambda r: r.foot_contact).astype(np.bool_), 5, 5)[dynamics.rows]
    loaded = steady & (normal > SLIP_NORMAL_N)
    ratio = np.where(loaded, shear / np.maximum(normal, 1.0), 0.0)
    largest = float(np.quantile(ratio[loaded], LARGEST_QUANTILE)) if loaded.any() else np.inf
    slipping = loaded & sliding & (ratio > NEAR_LIMIT * largest)
    index, legs = np.nonzero(slipping)
    return dynamics.rows[index], legs.astype(np.intp), ratio[index, legs]


def _stop_times(stance: StanceSignals) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Row and leg of each touch-down that is fast enough, and in which time (s) the ground takes half of its speed."""
    stack = stance.stack
    raw = feet(stance.kinematics, stance.foot_radius_m, stance.standing)[:, 2 : 3 * facts.N_LEGS : 3]
    velocity = stack.smooth(raw)
    contact = stack.cat(lambda r: r.foot_contact).astype(np.bool_)
    usable = stack.inner(stack.used, SEARCH, STOP_LAST)
    rows, legs, times = [], [], []
    for leg in range(facts.N_LEGS):
        changes = np.flatnonzero(np.diff(contact[:, leg].astype(np.int8)) == 1) + 1
        for row in changes[usable[changes]]:
            path = velocity[row - STOP_AROUND : row + STOP_LAST, leg]
            fastest = int(np.argmin(path[: 2 * STOP_AROUND + 1]))
            falling = float(path[fastest])
            if falling > -STOP_M_S or not contact[row : row + STOP_AROUND + 4, leg].all():
                continue
            first, last = (_crossing(path[fastest:], share * falling) for share in (STOP_FROM, STOP_TO))
            if np.isfinite(last):
                rows.append(int(row))
                legs.append(leg)
                times.append((last - first) * stack.period_s)
    return np.array(rows, dtype=np.intp), np.array(legs, dtype=np.intp), np.array(times, dtype=np.float64)


def _crossing(path: Array, level: float) -> float:
    """Where a path that begins below a level first crosses it, in samples; infinite where it never does."""
    above = np.flatnonzero(path[1:] >= level)
    if len(above) == 0:
        return np.inf
    k = int(above[0])
    return k + float((level - path[k]) / (path[k + 1] - path[k]))
