"""Logs made ready: missing gains from the robot's file, loads from its motion, commands put in step with loads.

New set-points of a policy are steps between which nothing is asked, so the load's answer to a step stands by itself;
whatever is smooth in the motion, as viscous friction is, cannot pass for a lag. Recordings in which every row brings
another set-point have no such steps: there the servo law's torque is moved against the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from diagnosis.read.fixed_base import Drives, error_rad, fitted_drives, loads_nm
from diagnosis.read.robot_file import RobotFile
from spot_log.read.run import Run
from spot_model.robot.facts import Array
from trainer.signals.smoothing import rate_over, smooth, too_coarse

MAX_ROWS_APART: Final = 12
"""A recording may pair a command with a load that comes this many rows earlier or later."""
STEP_ROWS: Final = 0.25
FINEST_NS: Final = 1e6
"""In place of :data:`STEP_ROWS`, where a quarter of a row is more."""
ALIKE: Final = 0.02
"""Pairings alike: what they leave lies within this share of what the best one gains."""
BETTER: Final = 0.9
"""Another pairing must leave less than this share of the difference's mean square."""
LOAD_LAG_ROWS: Final = 0.5
"""By which a load is older than its state where nothing tells: what is least wrong for a torque loop within a state."""
SPARSE: Final = 1.0 / 3.0
"""Set-points that change in a smaller share of the states are steps."""
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


def rows_in_motion(runs: Sequence[Run], robot: RobotFile) -> float:
    """By how many states commands act late, so that simulations come nearest to the motion; loads are computed.

    Torques cannot tell: a delay looks like friction and a rotor, and a late servo law is smaller. 0 where it hardly
    matters.
    """
    costs: list[float] = []
    for rows in range(MAX_ROWS_APART):
        late_s = rows * _period_s(runs[0])
        found = [error_rad(robot, run, replace(drives_of(run, rows)[0], delay_s=late_s)) for run in runs]
        costs.append(float(np.mean(np.square(found))))
        if costs[-1] > 1.5 * min(costs):
            break
    best = int(np.argmin(costs))
    return float(best) if costs[best] < BETTER * costs[0] and best < MAX_ROWS_APART - 1 else 0.0


def with_servo_law(run: Run, late_ns: int = 0) -> tuple[Array, Array]:
    """The servo law at each state in two parts: what the newest command pulls with, and what the joint itself takes.

    Args:
        run: The log.
        late_ns: How much later than its stamp a command acts.
    """
    states, c = run.states, run.commands
    row = np.clip(np.searchsorted(c.robot_stamp_ns, states.robot_stamp_ns - late_ns, side="right") - 1, 0, len(c) - 1)
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
    """For each step and each state around it: offset in states, change of load along the step, square of the step."""
    states, c = run.states, run.commands
    ask = np.nan_to_num(c.kp_nm_per_rad * c.position_rad)
    step = np.diff(ask, axis=0)
    change = np.diff(states.load_nm, axis=0)
    changed = np.flatnonzero(np.abs(step).max(axis=1) > 0.0) if len(step) else np.zeros(0, dtype=np.intp)
    if not 40 <= len(changed) < SPARSE * len(states):
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
    """By how many states commands are late where the servo law fits best; 0 if that hardly helps, or has no best."""
    period_ns = 1e9 * _period_s(runs[0])
    per_row = round(1.0 / min(STEP_ROWS, FINEST_NS / period_ns))
    shifts = np.arange(-MAX_ROWS_APART * per_row, MAX_ROWS_APART * per_row + 1) / per_row
    costs = np.zeros(len(shifts))
    for run in runs:
        load = run.states.load_nm
        size = np.maximum(np.nanstd(load, axis=0), 1e-9)
        inner = slice(MAX_ROWS_APART + 1, len(load) - MAX_ROWS_APART - 1)
        for i, shift in enumerate(shifts):
            pulled, own = with_servo_law(run, round(shift * period_ns))
            costs[i] += float(np.nanvar(((load - pulled + own) / size)[inner], axis=0).mean())
    best = int(np.argmin(costs))
    at_rest = MAX_ROWS_APART * per_row
    if costs[best] >= BETTER * costs[at_rest] or best in (0, len(shifts) - 1):
        return 0.0
    # Between two phases at which commands come every shift fits alike. Where they come row by row with the states, that
    # is a whole row, and a row's command acts at its state.
    far = np.flatnonzero(costs > costs[best] + ALIKE * (costs[at_rest] - costs[best]))
    first, last = int(max(far[far < best], default=-1)) + 1, int(min(far[far > best], default=len(shifts))) - 1
    is_by_rows = last - first + 1 >= per_row
    return float(shifts[last] if is_by_rows else 0.5 * (shifts[first] + shifts[last]))


MIN_AGREEMENT: Final = 0.6
"""Correlation of the servo law's torque with computed loads, friction and rotors, at least."""


def prepared(runs: Sequence[Run], robot: RobotFile) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Complete the logs; nothing changes in a log of the runtime on Spot.

    Returns:
        The logs, and what was done, a sentence each.

    Raises:
        BadInputError: The robot's MJCF does not fit it.
    """
    notes: list[str] = []
    out = [_without_gaps(run, notes) for run in runs]
    out = [with_own_gains(run, robot) for run in out]
    if robot.is_from_motion:
        out = [_with_load(run, robot, notes) for run in out]
        if any(np.isfinite(run.states.load_nm).any() for run in out):
            told = "loads are computed from the motion by the robot's MJCF: its errors count as the drive's"
            notes.append(f"{told}, and a torque gain as heavier links")
    unstamped = [run for run in out if not (run.states.last_command_key > 0).any() and len(run.commands)]
    if unstamped and all(np.isfinite(run.states.load_nm).any() for run in unstamped):
        rows = rows_in_motion(unstamped, robot) if robot.is_from_motion else rows_apart(unstamped)
        shift_s = rows * _period_s(unstamped[0])
        if shift_s != 0.0:
            out = [_shifted(run, round(shift_s * 1e9)) if run in unstamped else run for run in out]
            told = "the motion answers its commands after" if robot.is_from_motion else "loads follow their commands by"
            notes.append(
                f"{told} {1e3 * shift_s:.1f} ms; this is taken off, as without receipts of commands the recording "
                "itself may add it. A delay of that size cannot be found"
            )
    return tuple(out), tuple(notes)


def _without_gaps(run: Run, notes: list[str]) -> Run:
    """Leave out states with a joint signal that is not a number, if the log has the signal at all."""
    states = run.states
    bad = np.zeros(len(states), dtype=np.bool_)
    for values in (states.position_rad, states.velocity_rad_s, states.load_nm):
        if values.size and np.isfinite(values).any():
            bad |= ~np.isfinite(values).all(axis=1)
    if not bad.any():
        return run
    notes.append(f"log {run.path.name}: {int(bad.sum())} states with a signal that is not a number are left out")
    return replace(run, states=states.rows(~bad))


def with_own_gains(run: Run, robot: RobotFile) -> Run:
    """The log with the robot's gains where it has none."""
    given = {"kp_nm_per_rad": robot.each(robot.kp_nm_per_rad), "kd_nm_s_per_rad": robot.each(robot.kd_nm_s_per_rad)}
    filled: dict[str, Any] = {}
    for name, gains in given.items():
        own = getattr(run.commands, name)
        if gains is not None and not np.isfinite(own).any():
            filled[name] = np.broadcast_to(gains, own.shape).copy()
    return replace(run, commands=replace(run.commands, **filled)) if filled else run


def _with_load(run: Run, robot: RobotFile, notes: list[str]) -> Run:
    """The load that the links' motion needs, from smoothed signals. Loads of the log itself are not used.

    No load where it would mean nothing: from states far apart, or unlike what was asked for.
    """
    states, period_s = run.states, _period_s(run)
    velocity = states.velocity_rad_s
    if not np.isfinite(velocity).any():
        velocity = rate_over(states.position_rad, states.robot_stamp_ns)
    acceleration = rate_over(velocity, states.robot_stamp_ns)
    load = loads_nm(robot, smooth(states.position_rad), smooth(velocity), acceleration)
    made = replace(run, states=replace(states, load_nm=load, velocity_rad_s=velocity))
    if coarse := too_coarse(period_s):
        notes.append(f"log {run.path.name}: {coarse}: loads computed from its motion are not used")
    elif (agreement := _agreement(made)) < MIN_AGREEMENT:
        notes.append(
            f"log {run.path.name}: loads computed from the motion do not follow the set-points (correlation "
            f"{agreement:.2f}; at least {MIN_AGREEMENT} is needed): velocities are too coarse, the MJCF is of another "
            "robot, or a controller makes the torque from the velocity, as friction does; they are not used"
        )
    else:
        return made
    return replace(made, states=replace(made.states, load_nm=np.full_like(load, np.nan)))


def _agreement(run: Run) -> float:
    """How well computed loads, friction and rotors account for the servo law's torque, in the median of the joints.

    A correlation, 0 where nothing was asked. Friction and rotor inertia are fitted, and cannot give: in the air, a
    geared leg's motor works against little else.
    """
    pulled, own = with_servo_law(run)
    rest, size = drives_of(run)[1].var(axis=0), smooth(pulled - own).var(axis=0)
    found = 1.0 - rest[size > 0] / size[size > 0]
    return float(np.sqrt(max(0.0, np.median(found)))) if found.size else 0.0


def drives_of(run: Run, rows: float = 0.0) -> tuple[Drives, Array]:
    """Drives that the log's motion and its commands, so many states late, speak for; and what they leave, (n, J)."""
    pulled, own = with_servo_law(run)
    beyond = smooth(moved(pulled, rows) - own) - smooth(run.states.load_nm)
    return fitted_drives(beyond, run.states.velocity_rad_s, run.states.robot_stamp_ns)


def _period_s(run: Run) -> float:
    return float(np.median(np.diff(run.states.robot_stamp_ns))) * 1e-9


def _shifted(run: Run, shift_ns: int) -> Run:
    c = run.commands
    end = np.where(c.end_robot_stamp_ns > 0, c.end_robot_stamp_ns + shift_ns, c.end_robot_stamp_ns)
    return replace(run, commands=replace(c, robot_stamp_ns=c.robot_stamp_ns + shift_ns, end_robot_stamp_ns=end))
