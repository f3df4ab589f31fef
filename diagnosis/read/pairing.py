"""By how much loads come after commands, for logs in which nobody says when a command was received.

New set-points of a policy are steps between which nothing is asked, so the load's answer to a step stands by itself;
whatever is smooth in the motion, as viscous friction is, cannot pass for a lag. Recordings in which every row brings
another set-point have no such steps: there the servo law's torque is moved against the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from spot_log.read.run import Run
from trainer.signals.recording import Array
from trainer.signals.smoothing import smooth

MAX_ROWS_APART: Final = 12
"""A recording may pair a command with a load that comes this many rows earlier or later."""
STEP_ROWS: Final = 0.25
BETTER: Final = 0.9
"""Another pairing must leave less than this share of the difference's mean square."""
LOAD_LAG_ROWS: Final = 0.5
"""By which a load is older than its state where nothing tells: what is least wrong for a torque loop within a state."""
SPARSE: Final = 1.0 / 3.0
"""Set-points that change in a smaller share of the states are steps."""
MIN_STEPS: Final = 40
BEFORE_PEAK, AFTER_PEAK = 2, 4
"""Rows around the largest answer in which it is summed up: less than the time to the next tick's."""
CLEAR: Final = 1.25
"""The largest answer, over those to the steps before and after: steps of one stride resemble each other."""
OUTLIER: Final = 3.0
"""Changes of load count up to so many standard deviations: impacts are no answers."""


def rows_apart(runs: Sequence[Run]) -> float:
    """By how many states loads come after commands; 0 where logs do not show it."""
    by_steps = _after_steps(runs)
    return by_steps if by_steps is not None else _by_moving(runs)


def servo_law(run: Run) -> tuple[Array, Array]:
    """The servo law at each state in two parts: what the newest command pulls with, and what the joint itself takes."""
    states, c = run.states, run.commands
    row = np.clip(np.searchsorted(c.robot_stamp_ns, states.robot_stamp_ns, side="right") - 1, 0, len(c) - 1)
    kp, kd = np.nan_to_num(c.kp_nm_per_rad[row]), np.nan_to_num(c.kd_nm_s_per_rad[row])
    pulled = np.nan_to_num(kp * c.position_rad[row]) + np.nan_to_num(kd * c.velocity_rad_s[row])
    own = kp * states.position_rad + kd * np.nan_to_num(states.velocity_rad_s)
    return pulled + np.nan_to_num(c.load_nm[row]), own


def moved(values: Array, rows: float) -> Array:
    """A signal that comes so many rows later, shape (n, J)."""
    at = np.arange(len(values), dtype=np.float64)
    return np.stack([np.interp(at - rows, at, column) for column in values.T], axis=1)


def _after_steps(runs: Sequence[Run]) -> float | None:
    """States from a step to its effect; None without steps or answers.

    Half of the load's answer has come by then and the load's own lag, which is taken to be half a state.
    """
    found = [part for run in runs if (part := _answers(run)) is not None]
    if len(found) < len(runs):
        return None
    at, answer, size = (np.concatenate(part) for part in zip(*found, strict=True))
    n_bins = round(2 * MAX_ROWS_APART / STEP_ROWS)
    place = np.clip(((at + MAX_ROWS_APART) / STEP_ROWS).astype(np.intp), 0, n_bins - 1)
    weight = np.bincount(place, size, minlength=n_bins)
    centre = (np.arange(n_bins) + 0.5) * STEP_ROWS - MAX_ROWS_APART
    # Commands may always come at the same few phases of the state stream.
    filled = weight > 0.02 * weight.max()
    response = np.interp(centre, centre[filled], np.bincount(place, answer, minlength=n_bins)[filled] / weight[filled])
    # What a state shows has come since the state before.
    by_row = np.convolve(response, np.full(round(1 / STEP_ROWS), STEP_ROWS), mode="same")
    peak = int(np.argmax(by_row))
    near = np.abs(centre - centre[peak])
    if by_row[peak] <= CLEAR * np.max(np.abs(by_row[near > AFTER_PEAK])):
        return None
    around = (centre > centre[peak] - BEFORE_PEAK) & (centre < centre[peak] + AFTER_PEAK)
    so_far = np.cumsum(np.maximum(response[around], 0.0))
    half = np.interp(0.5 * so_far[-1], so_far, centre[around] + 0.5 * STEP_ROWS)
    # A state shows what has come since the state before: half a state late.
    return float(half - 0.5 - LOAD_LAG_ROWS)


def _answers(run: Run) -> tuple[Array, Array, Array] | None:
    """Of each step and each state around it: offset in states, change of load along the step, square of the step."""
    states, c = run.states, run.commands
    ask = np.nan_to_num(c.kp_nm_per_rad * c.position_rad)
    step = np.diff(ask, axis=0)
    change = np.diff(states.load_nm, axis=0)
    changed = np.flatnonzero(np.abs(step).max(axis=1) > 0.0) if len(step) else np.zeros(0, dtype=np.intp)
    if not MIN_STEPS <= len(changed) < SPARSE * len(states):
        return None
    step = step[changed] / np.maximum(np.std(step[changed], axis=0), 1e-9)
    change = np.nan_to_num(change / np.maximum(np.nanstd(change, axis=0), 1e-9))
    change = np.clip(change, -OUTLIER, OUTLIER)
    sent, stamp = c.robot_stamp_ns[changed + 1], states.robot_stamp_ns[1:]
    row = np.searchsorted(stamp, sent)[:, None] + np.arange(-MAX_ROWS_APART, MAX_ROWS_APART)
    inside = (row >= 0) & (row < len(stamp))
    row = np.clip(row, 0, len(stamp) - 1)
    offset = (stamp[row] - sent[:, None]) / float(np.median(np.diff(stamp)))
    answer = np.einsum("ekj,ej->ek", change[row], step)
    size = np.broadcast_to((step**2).sum(axis=1)[:, None], row.shape)
    inside &= np.abs(offset) < MAX_ROWS_APART
    return offset[inside], answer[inside], size[inside]


def _by_moving(runs: Sequence[Run]) -> float:
    """By how many states the servo law's torque is best moved; 0 where that is hardly better."""
    shifts = np.arange(-MAX_ROWS_APART, MAX_ROWS_APART + STEP_ROWS, STEP_ROWS)
    costs = np.zeros(len(shifts))
    for run in runs:
        pulled, own, load = *servo_law(run), run.states.load_nm
        size = np.maximum(np.nanstd(load, axis=0), 1e-9)
        inner = slice(MAX_ROWS_APART + 1, len(load) - MAX_ROWS_APART - 1)
        for i, shift in enumerate(shifts):
            # Smoothed alike: between two rows a straight line is itself a filter.
            off = smooth((load - moved(pulled, float(shift)) + own) / size)[inner]
            costs[i] += float(np.nanvar(off, axis=0).mean())
    best = int(np.argmin(costs))
    at_rest = int(np.flatnonzero(shifts == 0.0)[0])
    return float(shifts[best]) if costs[best] < BETTER * costs[at_rest] else 0.0
