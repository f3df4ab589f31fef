"""Channel *contact events*: contact flags and slips against the forces that the legs' loads say the feet carry.

Rows, leg by leg: how late a flag changes after the force does, s, one sample a touch-down or lift-off; the friction
coefficient at which a foot slips less the nominal model's, one sample a slipping state; and how long the ground takes
to stop a foot, s, less the nominal model's time, one sample a touch-down. Time convention: a force counts as changed
when it crosses a threshold; smoothing is symmetrical in time; a foot's stop is timed by its own velocity alone, so that
a late flag shifts nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels import Array, Channel, ChannelOff, ChannelView, Flags
from diagnosis.channels.dynamics import DynamicsSignals
from spot_model.robot import facts
from spot_model.robot.mjcf_options import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz
from trainer.signals.smoothing import smooth

ROWS: Final = tuple(f"{leg}_{kind}" for kind in ("flag", "slip", "stop") for leg in facts.LEG_NAMES)
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
"""Stopping time of a critically damped contact, in time constants: 0.42 to 0.45 in trials, from 20 to 44 ms."""
NOMINAL_STOP_S: Final = STOP_PER_TIME_CONSTANT * MjcfOptions().contact_solref[0]
STOP_FLOOR_S: Final = 1.5e-3
FLAG_BIAS_S: Final = 6e-3
"""A smoothed force rises this much before the flag of a contact does; in trials 5 to 7 ms."""
FLAG_FLOOR_S: Final = 6e-3
SLIP_FLOOR: Final = 0.05


Events = tuple[NDArray[np.intp], NDArray[np.intp], Array]
"""Rows of the stack, legs, and what was found of each."""


def contact_view(dynamics: DynamicsSignals, stance: ChannelView) -> ChannelView | ChannelOff:
    """Build the channel *contact events*, with what channel *stance kinematics* has of the feet's motion."""
    slip_rows, slip_legs, ratios = _slips(dynamics, stance.response)
    stop_rows, stop_legs, stop_s = _stop_times(dynamics, smooth(stance.signals.rising_m_s))
    kinds: tuple[Events, ...] = (
        _flag_delays(dynamics, vertical_force_n(dynamics)),
        (slip_rows, slip_legs, ratios - dynamics.model.foot_friction[slip_legs]),
        (stop_rows, stop_legs, stop_s - NOMINAL_STOP_S),
    )
    every = np.concatenate([rows for rows, _, _ in kinds])
    if len(every) == 0:
        return ChannelOff(Channel.CONTACT_EVENTS, "no foot ever lifts off or touches down")
    at = np.arange(len(every)), np.concatenate([kind * facts.N_LEGS + legs for kind, (_, legs, _) in enumerate(kinds)])
    response = np.zeros((len(every), len(ROWS)))
    usable = np.zeros(response.shape, dtype=np.bool_)
    response[at], usable[at] = np.concatenate([found for _, _, found in kinds]), True
    legs = np.arange(facts.N_LEGS)
    return dynamics.stack.view(
        Channel.CONTACT_EVENTS,
        every,
        response,
        rows=ROWS,
        unit="s, 1, s",
        usable=usable,
        noise=np.repeat([FLAG_FLOOR_S, SLIP_FLOOR, STOP_FLOOR_S], facts.N_LEGS),
        row_leg=np.tile(legs, 3),
        leg_of_joint=np.repeat(legs, 3),
        signals=dynamics.model,
    )


def _force_in_world_n(dynamics: DynamicsSignals) -> Array:
    """Force on each foot at the kept rows; shape (n, 4, 3)."""
    return np.asarray(rotate_wxyz(dynamics.inputs.world_from_body_wxyz[:, None, :], dynamics.nominal.foot_force_n))


def vertical_force_n(dynamics: DynamicsSignals) -> Array:
    """Vertical force on each foot at the full rate, interpolated between the kept rows; shape (N, 4)."""
    every = np.arange(dynamics.stack.n)
    force = _force_in_world_n(dynamics)[..., 2]
    return np.stack([np.interp(every, dynamics.rows, of_leg) for of_leg in force.T], axis=1)


def _changes(contact: Flags, usable: Flags) -> Iterator[tuple[int, int, bool]]:
    """Leg and row of each usable change of a flag, and whether it is a touch-down."""
    for leg in range(facts.N_LEGS):
        rows = np.flatnonzero(np.diff(contact[:, leg].astype(np.int8))) + 1
        yield from ((leg, int(row), bool(contact[row, leg])) for row in rows[usable[rows]])


def _events(found: Sequence[tuple[int, int, float]]) -> Events:
    rows, legs, values = np.array(found, dtype=np.float64).reshape(-1, 3).T
    return rows.astype(np.intp), legs.astype(np.intp), values


def _flag_delays(dynamics: DynamicsSignals, normal_n: Array) -> Events:
    """Lateness (s) of each change of a flag that has a clear crossing of the force beside it."""
    stack = dynamics.stack
    found: list[tuple[int, int, float]] = []
    for leg, row, touches in _changes(dynamics.contact, stack.inner(stack.used, SEARCH, SEARCH)):
        window = normal_n[row - SEARCH : row + SEARCH, leg]
        level = float(np.max(window[SEARCH:] if touches else window[:SEARCH]))
        above = window > THRESHOLD_SHARE * level
        crossings = np.flatnonzero(np.diff(above.astype(np.int8)) == (1 if touches else -1))
        if level >= MIN_LEVEL_N and len(crossings) == 1:
            k = int(crossings[0])
            share = (THRESHOLD_SHARE * level - window[k]) / (window[k + 1] - window[k])
            found.append((row, leg, (SEARCH - (k + share)) * stack.period_s - FLAG_BIAS_S))
    return _events(found)


def _slips(dynamics: DynamicsSignals, stance: Array) -> Events:
    """Ratio of shear to normal force of each state in which a loaded foot slips; the stance's response, (n, 16)."""
    force = _force_in_world_n(dynamics)
    normal, shear = force[..., 2], np.hypot(force[..., 0], force[..., 1])
    velocity = stance[:, : 3 * facts.N_LEGS].reshape(-1, facts.N_LEGS, 3)
    sliding = np.hypot(velocity[..., 0], velocity[..., 1]) > SLIP_M_S
    loaded = dynamics.stack.inner(dynamics.contact, 5, 5)[dynamics.rows] & (normal > SLIP_NORMAL_N)
    ratio = np.where(loaded, shear / np.maximum(normal, 1.0), 0.0)
    largest = float(np.quantile(ratio[loaded], LARGEST_QUANTILE)) if loaded.any() else np.inf
    index, legs = np.nonzero(loaded & sliding & (ratio > NEAR_LIMIT * largest))
    return dynamics.rows[index], legs, ratio[index, legs]


def _stop_times(dynamics: DynamicsSignals, velocity: Array) -> Events:
    """Time in which the ground takes half of the speed of each touch-down that is fast enough, s.

    The velocity is that of the contact points, upwards, smoothed, m/s, shape (N, 4).
    """
    stack, contact = dynamics.stack, dynamics.contact
    found: list[tuple[int, int, float]] = []
    for leg, row, touches in _changes(contact, stack.inner(stack.used, SEARCH, STOP_LAST)):
        path = velocity[row - STOP_AROUND : row + STOP_LAST, leg]
        fastest = int(np.argmin(path[: 2 * STOP_AROUND + 1]))
        falling = float(path[fastest])
        if not touches or falling > -STOP_M_S or not contact[row : row + STOP_AROUND + 4, leg].all():
            continue
        first, last = (_crossing(path[fastest:], share * falling) for share in (STOP_FROM, STOP_TO))
        if np.isfinite(last):
            found.append((row, leg, (last - first) * stack.period_s))
    return _events(found)


def _crossing(path: Array, level: float) -> float:
    """Where a path that begins below a level first crosses it, in samples; infinite where it never does."""
    if not np.any(path[1:] >= level):
        return np.inf
    k = int(np.argmax(path[1:] >= level))
    return k + float((level - path[k]) / (path[k + 1] - path[k]))
