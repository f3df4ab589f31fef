"""The gaits of a run: one for each stretch in which the command stayed the same or changed steadily."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.gait import Gait, measure_gait
from spot_model.robot.leg_kinematics import foot_position_and_jacobian
from spot_model.robot.rotation import rotate_wxyz

NS = 1e-9
SAME_COMMAND = 1e-3
"""Change of V_x, V_y (m/s) or ω_z (rad/s) from tick to tick that a held command may have."""
LEAST_S = 3.0
"""Shorter stretches hold too few strides to name a gait."""
RAMP_STEP_S = 0.1
"""A command that holds for no longer than this is on its way to another: neighbours make one stretch, a ramp."""
SETTLE_S = 1.0
"""Time after a change of the command in which the gait is still changing."""
MISSING_S = 0.5
"""A longer pause between ticks ends a stretch."""
Velocity = tuple[float, float, float]


@dataclass(frozen=True)
class GaitSpan:
    """A stretch of time under one velocity command, or under one that changes steadily."""

    start_s: float
    """Seconds after the first state, robot time."""
    end_s: float
    """Seconds after the first state, robot time."""
    first_command: Velocity
    """V_x, V_y (m/s), ω_z (rad/s) at the start."""
    command: Velocity
    """V_x, V_y (m/s), ω_z (rad/s) at the end; in a ramp they differ from the start."""
    gait: Gait
    """The gait; below."""


def gaits(run: Run) -> list[GaitSpan]:
    """Measure the gait of every stretch of three seconds or more in which the velocity command was held or ramped.

    Returns:
        A span each, in order: ``start_s``, ``end_s``, ``command`` and ``gait`` (``name``, ``stride_hz``, ``duty``,
        ``flight_share``, …; ``gait.sentence()`` says it in words). Empty where the run has no contacts or no policy.
    """
    states = run.states
    if states.foot_contact.shape[1:] != (facts.N_LEGS,) or len(states) < 2:
        return []
    stamp_s = (states.robot_stamp_ns - states.robot_stamp_ns[0]) * NS
    rows = np.flatnonzero(np.diff(np.maximum.accumulate(stamp_s), prepend=-np.inf) > 0)
    descent = foot_descent_m_s(run)
    found: list[GaitSpan] = []
    for start_s, end_s, first, last in _stretches(run):
        inside = rows[(stamp_s[rows] >= start_s + SETTLE_S) & (stamp_s[rows] <= end_s)]
        if len(inside) < 2 or len(found) >= 100:
            continue
        speeds = descent[inside] if np.isfinite(descent[inside]).all() else None
        gait = measure_gait(stamp_s[inside], states.foot_contact[inside], speeds)
        found.append(GaitSpan(start_s + SETTLE_S, end_s, first, last, gait))
    return found


def foot_descent_m_s(run: Run) -> Array:
    """Downward speed of the feet, shape (n, 4), m/s; NaN where the log lacks what it takes."""
    states = run.states
    if states.position_rad.shape[1] < facts.N_JOINTS:
        return np.full((len(states), facts.N_LEGS), np.nan)
    joints, rates = states.position_rad[:, : facts.N_JOINTS], states.velocity_rad_s[:, : facts.N_JOINTS]
    arm, jacobian = foot_position_and_jacobian(joints)
    relative = (jacobian * rates.reshape(-1, facts.N_LEGS, 1, 3)).sum(axis=-1)
    attitude = states.odom_from_body_wxyz[:, None, :]
    spin = np.cross(states.angular_vel_of_body_in_odom_rad_s[:, None, :], rotate_wxyz(attitude, arm))
    velocity = states.linear_vel_of_body_in_odom_m_s[:, None, :] + spin + rotate_wxyz(attitude, relative)
    return np.asarray(-velocity[..., 2])


def gait_line(span: GaitSpan) -> str:
    """One stretch in a line."""
    v_x, v_y, yaw = (
        f"{a:.2f}" if abs(b - a) <= SAME_COMMAND else f"{a:.2f} to {b:.2f}"
        for a, b in zip(span.first_command, span.command, strict=True)
    )
    touchdown = span.gait.touchdown_m_s
    is_walk = math.isfinite(touchdown) and span.gait.stride_hz and span.gait.name != "stand"
    hard = f", touch-down at {touchdown:.2f} m/s" if is_walk else ""
    return f"{span.start_s:.1f} to {span.end_s:.1f} s at ({v_x}, {v_y} m/s, {yaw} rad/s): {span.gait.sentence()}{hard}"


def _stretches(run: Run) -> list[tuple[float, float, Velocity, Velocity]]:
    """Start, end (s after the first state), first and last command of each stretch of policy ticks."""
    ticks = run.ticks
    ran = np.flatnonzero(np.isfinite(ticks.action).all(axis=1)) if len(ticks) else np.zeros(0, dtype=np.int64)
    if len(ran) < 2:
        return []
    stamp_s = (ticks.robot_stamp_ns[ran] - run.states.robot_stamp_ns[0]) * NS
    command = ticks.velocity_command[ran]
    starts = np.flatnonzero(_changes(command, stamp_s))
    ends = np.append(starts[1:], len(ran)) - 1
    is_step = stamp_s[ends] - stamp_s[starts] <= RAMP_STEP_S
    goes_on = is_step[1:] & is_step[:-1] & (stamp_s[starts[1:]] - stamp_s[ends[:-1]] <= MISSING_S)
    begins = np.append(True, ~goes_on)
    return [
        (float(stamp_s[a]), float(stamp_s[b]), _velocity(command[a]), _velocity(command[b]))
        for a, b in zip(starts[begins], ends[np.append(begins[1:], True)], strict=True)
        if stamp_s[b] - stamp_s[a] >= LEAST_S
    ]


def _velocity(command: Array) -> Velocity:
    return float(command[0]), float(command[1]), float(command[2])


def _changes(command: Array, stamp_s: Array) -> NDArray[np.bool_]:
    """Where a stretch begins: the command jumps or ramps, or ticks are missing."""
    jumps = (np.abs(np.diff(command, axis=0)) > SAME_COMMAND).any(axis=1) | (np.diff(stamp_s) > MISSING_S)
    return np.concatenate([[True], jumps])
