"""The lag of a load behind the states, found from the steps that new set-points make.

A lag cannot be told from viscous friction and inertia by anything smooth. A new set-point is a step at a known instant,
before which nothing can show. Set-points arrive at all phases of the states, so the lag is found below their period.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels import Array
from diagnosis.channels.stack import Stack
from diagnosis.read.prepare import LOAD_LAG_ROWS
from trainer.signals.recording import Recording
from trainer.signals.smoothing import eroded

LAG_STEP_S: Final = 0.1e-3
MIN_EVENTS: Final = 40
WIDE_SHARE: Final = 0.25
"""A lag that may lie anywhere in this share of the period is reported."""
MAX_EVENTS: Final = 2_500
"""Evenly thinned to so many set-points."""
ONE_PHASE: Final = 0.05
"""Share of a period within which commands always come, if a recording has them row by row with its states."""


def load_lag_s(stack: Stack) -> tuple[float, str]:
    """The load's lag, between 0 and one period, s; and a note, empty where it was measured.

    Each new set-point, times its stiffness, is regressed on the change of the load at the first and the second state
    after it was received, with what came before in the load beside it. The lag is where the first state starts to show
    it.
    """
    steps, phase, loads = _step_events(stack)
    period = stack.period_s
    assumed = LOAD_LAG_ROWS * period
    if len(phase) < MIN_EVENTS:
        return assumed, f"the load's lag is assumed to be {1e3 * assumed:.1f} ms: too few set-points"
    lags = np.arange(0.0, period + 0.5 * LAG_STEP_S, LAG_STEP_S)
    costs = np.array([_lag_cost(steps, phase - lag, loads, period) for lag in lags])
    near = lags[costs <= np.min(costs) + 0.02 * (np.max(costs) - np.min(costs))]
    # Set-points that always come at one phase leave all lags before it alike.
    wide = float(near.max() - near.min())
    note = f"the load's lag is known to {1e3 * wide:.1f} ms only: set-points always come at one phase"
    return float(np.mean(near)), note if wide > WIDE_SHARE * period else ""


def between_states(stack: Stack, lag_s: float) -> Array:
    """What a rotor takes of a set-point's step within the period in which it comes, as far as states cannot tell.

    A load is measured at the end of a period, when the step is in it or not yet; the mean acceleration over the period
    has the part of it since it came. What a rotor's inertia makes of the difference is a nuisance. Shape (N, J), N·m.
    A recording of commands row by row with its states does not say when in a period they came: nothing is taken off.
    """
    parts: list[Array] = []
    for recording in stack.recordings:
        out = np.zeros((len(recording), recording.n_joints))
        step, received_ns, state, later = set_point_steps(recording)
        inside = (received_ns > recording.start_ns) & (state < len(recording)) & (later < 1.0)
        if not recording.has_receipts and inside.any() and np.ptp(later[inside]) < ONE_PHASE:
            inside[:] = False
        share = later[inside]
        seen = (share * recording.period_s >= lag_s).astype(np.float64)
        np.add.at(out, state[inside], (seen - share)[:, None] * np.nan_to_num(step[inside]))
        parts.append(out)
    return np.concatenate(parts)


def set_point_steps(recording: Recording) -> tuple[Array, NDArray[np.int64], NDArray[np.intp], Array]:
    """New set-points in their order, m in all.

    Returns:
        Stiffness times the step (m, J), N·m; when it was received, ns; the state after that, and how many periods later
        that is.
    """
    order = np.argsort(recording.command_ns, kind="stable")
    commands, received_ns = recording.commands, recording.command_ns[order][1:]
    step = np.diff((commands.kp_nm_per_rad * commands.position_rad)[order], axis=0)
    return step, received_ns, *recording.next_row(received_ns)


def _step_events(stack: Stack) -> tuple[Array, Array, Array]:
    """Set-point steps (m, J), N·m, phases (m,), s, and changes of the load from two states before to one after."""
    found: list[tuple[Array, Array, Array]] = []
    for used, recording in zip(np.split(stack.used, stack.starts()[1:]), stack.recordings, strict=True):
        step, _, state, later = set_point_steps(recording)
        inside = (state > 3) & (state < len(recording) - 4)
        keep = np.flatnonzero(inside)[eroded(used, 4, 4)[state[inside]]]
        change = np.diff(recording.load_nm, axis=0, prepend=recording.load_nm[:1])
        loads = np.stack([change[state[keep] + k] for k in (-2, -1, 0, 1)], axis=-1)
        found.append((step[keep], later[keep] * recording.period_s, loads))
    steps, phase, loads = (np.concatenate(p) for p in zip(*found, strict=True))
    finite = np.isfinite(steps).all(axis=1) & np.isfinite(phase) & np.isfinite(loads).all(axis=(1, 2))
    thin = max(1, -(-int(finite.sum()) // MAX_EVENTS))
    return steps[finite][::thin], phase[finite][::thin], loads[finite][::thin]


def _lag_cost(steps: Array, since_s: Array, loads: Array, period_s: float) -> float:
    """Robust cost of the best fit with a lag, all joints together; ``since_s`` is the phase less the lag, (m,)."""
    shows, since = (since_s > 0.0)[:, None], (since_s / period_s)[:, None]
    before, last, first, second = np.moveaxis(loads, -1, 0)
    zero = np.zeros_like(steps)
    now = [steps * shows, steps * shows * since, zero, last, before]
    later = [steps * ~shows, steps * ~shows * (1.0 + since), steps * shows, first, last]
    x = np.concatenate([np.stack(now, axis=-1), np.stack(later, axis=-1)])
    y = np.concatenate([first, second])
    residual = y - _lag_fit(x, y, np.ones_like(y))
    bound = 2.0 * 1.4826 * np.median(np.abs(residual), axis=0) + 1e-9
    size = np.abs(y - _lag_fit(x, y, np.minimum(1.0, bound / np.maximum(np.abs(residual), 1e-12))))
    scale = np.median(np.abs(y), axis=0) + 1e-9
    return float(np.sum(np.where(size < bound, 0.5 * size**2, bound * (size - 0.5 * bound)) / scale**2))


def _lag_fit(x: Array, y: Array, weight: Array) -> NDArray[np.float64]:
    """Weighted least-squares fit of y (n, J) by columns x (n, J, p), joint by joint; shape (n, J)."""
    gram = np.einsum("njp,nj,njq->jpq", x, weight, x, optimize=True)
    ridge = 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(x.shape[2]) + 1e-12 * np.eye(x.shape[2])
    right = np.einsum("njp,nj->jp", x, weight * y, optimize=True)
    return np.asarray(np.einsum("njp,jp->nj", x, np.linalg.solve(gram + ridge, right[..., None])[..., 0]))
