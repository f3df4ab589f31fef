"""Measures of a run: rates, gaps, delays, falls. Pure functions of a :class:`Run`, in robot time where possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Ints, Run
from spot_model.robot.facts import Array
from spot_model.robot.rotation import rotate_inverse_wxyz, tilt_rad

NS: Final = 1e-9
GAP_PERIODS: Final = 1.5
"""A gap is a step of stamps longer than this many median periods."""
CLOCK_ERROR_NS: Final = 10_000_000
"""Most by which the host's stamp may lie after the robot's for the same instant; a tick is twice as long."""
NEVER_NS: Final = np.iinfo(np.int64).max // 2
"""Receipt of a command that no state has shown."""
FALL_TILT_RAD: Final = np.deg2rad(60.0)
FALL_TILT_S: Final = 0.05
FALL_FLIGHT_S: Final = 0.3
"""A fall is a tilt above 60° for 50 ms, or no foot on the ground for 0.3 s while commands are sent."""


@dataclass(frozen=True)
class Spread:
    """Median, 99th percentile and largest of some values; all NaN where there is none."""

    count: int
    p50: float
    p99: float
    largest: float

    @staticmethod
    def of(values: NDArray[Any], scale: float = 1.0) -> Spread:
        """Summarise ``values``·``scale``; NaN values are left out."""
        kept = np.asarray(values, dtype=np.float64)
        kept = kept[np.isfinite(kept)] * scale
        if not len(kept):
            return Spread(0, float("nan"), float("nan"), float("nan"))
        p50, p99 = np.percentile(kept, [50, 99])
        return Spread(len(kept), float(p50), float(p99), float(kept.max()))


@dataclass(frozen=True)
class Steps:
    """How regular the stamps of one topic are."""

    rate_hz: float
    """Mean rate, (n − 1) over the time from first to last; NaN with fewer than two."""
    period_ms: Spread
    gaps: int
    """Steps longer than 1.5 median periods."""
    backward: int
    """Steps of zero or less: duplicated or back-dated messages."""


@dataclass(frozen=True)
class Fall:
    """One fall."""

    start_s: float
    """From the run's first state, robot time."""
    duration_s: float
    cause: str
    """``tilt`` or ``no foot on the ground``."""
    tilt_rad: float
    """Largest within it."""


def seconds(run: Run, stamps_ns: Ints) -> Array:
    """Robot stamps as seconds from the run's first state. Shape as given."""
    first = run.states.robot_stamp_ns[0] if len(run.states) else (stamps_ns[0] if len(stamps_ns) else 0)
    return _seconds_of(stamps_ns - first)


def _seconds_of(duration_ns: Ints) -> Array:
    return duration_ns.astype(np.float64) * NS


def steps(stamps_ns: Ints) -> Steps:
    """Regularity of integer stamps, shape (n,)."""
    if len(stamps_ns) < 2:
        return Steps(float("nan"), Spread.of(np.zeros(0)), 0, 0)
    delta_ns = np.diff(stamps_ns)
    span_s = float(stamps_ns[-1] - stamps_ns[0]) * NS
    rate = (len(stamps_ns) - 1) / span_s if span_s > 0 else float("nan")
    gaps = int(np.sum(delta_ns > GAP_PERIODS * np.median(delta_ns)))
    return Steps(rate, Spread.of(delta_ns, 1e-6), gaps, int(np.sum(delta_ns <= 0)))


def receipts_ns(run: Run) -> Ints:
    """When the robot received each command, by its own clock; :data:`NEVER_NS` where no state shows it. Shape (n,).

    A command that was followed by another before the next state is not seen. The first states of a run still echo the
    key of the last run's newest command, and keys count anew: a receipt from before the state that the command answers,
    or from before it was sent where it answers none, is another command's.
    """
    commands, states = run.commands, run.states
    out = np.full(len(commands), NEVER_NS, dtype=np.int64)
    row, found = _rows_of(commands.key, states.last_command_key)
    if found.any():
        answered, received = commands.state_robot_stamp_ns[row], states.last_command_robot_stamp_ns
        earliest = np.where(answered > 0, answered, commands.robot_stamp_ns[row] - CLOCK_ERROR_NS)
        own = found & (states.last_command_key > 0) & (received >= earliest)
        rows, first = np.unique(row[own], return_index=True)
        out[rows] = received[own][first]
    return out


def command_delay_s(run: Run) -> tuple[Array, Array]:
    """From the sending of each command to its arrival at the robot, both by the robot's clock.

    Returns:
        When each was sent (robot time, s from the first state) and its delay (s), both of shape (m,).
    """
    sent_ns, arrival_ns = run.commands.robot_stamp_ns, receipts_ns(run)
    known = (sent_ns != 0) & (arrival_ns < NEVER_NS)
    return seconds(run, sent_ns[known]), _seconds_of(arrival_ns[known] - sent_ns[known])


def acknowledge_lag_s(run: Run) -> Array:
    """From the sending of each echoed command to the receipt of its first echo, host clock. Shape (m,), s."""
    key, first = np.unique(run.states.last_command_key, return_index=True)
    row, found = _rows_of(run.commands.key, key)
    return _seconds_of(run.states.host_stamp_ns[first][found] - run.commands.host_stamp_ns[row[found]])


def state_to_command_s(run: Run) -> Array:
    """From the receipt of a state to the sending of the command that answers it, host clock. Shape (m,), s."""
    row, found = _rows_of(run.states.robot_stamp_ns, run.commands.state_robot_stamp_ns)
    received_ns = run.states.host_stamp_ns[row[found]]
    return _seconds_of(run.commands.host_stamp_ns[found] - received_ns)


def _rows_of(keys: Ints, wanted: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """First row of ``keys`` that holds each wanted one, and whether there is any (row 0 where there is none)."""
    if not len(keys):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=np.bool_)
    order = np.argsort(keys, kind="stable")
    row = order[np.clip(np.searchsorted(keys[order], wanted), 0, len(keys) - 1)]
    found: NDArray[np.bool_] = keys[row] == wanted
    return np.where(found, row, 0), found


def body_velocity(run: Run) -> tuple[Array, Array]:
    """Linear (m/s) and angular (rad/s) velocity of the body, expressed in the body frame. Both of shape (n, 3)."""
    states = run.states
    quaternion = states.odom_from_body_wxyz
    linear: Array = rotate_inverse_wxyz(quaternion, states.linear_vel_of_body_in_odom_m_s)
    angular: Array = rotate_inverse_wxyz(quaternion, states.angular_vel_of_body_in_odom_rad_s)
    return linear, angular


def tracking_error(run: Run) -> Array:
    """Velocity command minus body velocity at each tick: V_x, V_y (m/s), ω_z (rad/s). Shape (n_ticks, 3)."""
    if not len(run.states) or not len(run.ticks):
        return np.zeros((0, 3))
    linear, angular = body_velocity(run)
    measured = np.column_stack([linear[:, :2], angular[:, 2]])
    row, found = _rows_of(run.states.robot_stamp_ns, run.ticks.robot_stamp_ns)
    error: Array = run.ticks.velocity_command[found] - measured[row[found]]
    return error


def falls(run: Run) -> tuple[Fall, ...]:
    """Stretches in which the robot has fallen, by tilt or by all feet off the ground."""
    states = run.states
    if not len(states):
        return ()
    time_s = seconds(run, states.robot_stamp_ns)
    tilt = np.nan_to_num(tilt_rad(states.odom_from_body_wxyz))
    found = [(span, "tilt") for span in _spans(time_s, tilt > FALL_TILT_RAD, FALL_TILT_S)]
    if states.foot_contact.shape[1]:
        in_air = ~states.foot_contact.any(axis=1) & _in_joint_control(run)
        found += [(span, "no foot on the ground") for span in _spans(time_s, in_air, FALL_FLIGHT_S)]
    result = [
        Fall(float(time_s[a]), float(time_s[b] - time_s[a]), cause, float(tilt[a : b + 1].max()))
        for (a, b), cause in found
    ]
    return tuple(sorted(result, key=lambda fall: fall.start_s))


def _in_joint_control(run: Run) -> NDArray[np.bool_]:
    """States from the first to the last command: a robot that sits has no foot on the ground, and has not fallen."""
    stamps_ns, sent_ns = run.states.robot_stamp_ns, run.commands.robot_stamp_ns
    if not len(sent_ns):
        return np.ones(len(stamps_ns), dtype=np.bool_)
    inside: NDArray[np.bool_] = (stamps_ns >= sent_ns[0]) & (stamps_ns <= sent_ns[-1])
    return inside


def _spans(time_s: Array, mask: NDArray[np.bool_], least_s: float) -> list[tuple[int, int]]:
    """First and last index of every stretch where the mask holds for at least ``least_s``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    spans = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [(a, b) for a, b in spans if time_s[b] - time_s[a] >= least_s]


def has_falls_signals(run: Run) -> bool:
    """Whether the log has the signals that tell a fall: an orientation, or foot contacts."""
    return bool(np.isfinite(run.states.odom_from_body_wxyz).any()) or run.states.foot_contact.size > 0


def clamped_commands(run: Run) -> int:
    """Commands whose set-points differ from what was asked for."""
    commands = run.commands
    both = np.isfinite(commands.requested_position_rad).all(axis=1)
    return int(np.sum((commands.requested_position_rad != commands.position_rad).any(axis=1) & both))


def dropped(run: Run) -> dict[str, int]:
    """Messages lost before they reached the disk, by topic: what the footer says; without one, gaps of the states."""
    if run.footer is not None:
        return dict(run.footer.dropped)
    sequence = run.states.sequence
    return {"state": int(sequence.max() + 1 - len(sequence)) if len(sequence) else 0}


def control_span_s(run: Run) -> tuple[float, float]:
    """From the first to the last tick, without standing up and sitting down; the whole log where it has no ticks."""
    stamps = run.ticks.robot_stamp_ns if len(run.ticks) > 1 else run.states.robot_stamp_ns
    first, last = seconds(run, stamps[[0, -1]]) if len(stamps) else (0.0, 0.0)
    return float(first), float(last)


def distance_m(run: Run) -> float:
    """Length of the body's path over the ground under control; NaN without a pose.

    It is sampled every 0.1 s, so that sway counts little.
    """
    if len(run.states) < 2:
        return 0.0
    if not np.isfinite(run.states.position_of_body_in_odom_m).any():
        return float("nan")
    begin_s, end_s = control_span_s(run)
    time_s = seconds(run, run.states.robot_stamp_ns)
    rows = np.unique(np.searchsorted(time_s, np.append(np.arange(begin_s, end_s, 0.1), end_s)))
    rows = rows[rows < len(time_s)]
    path = run.states.position_of_body_in_odom_m[rows, :2]
    return float(np.nansum(np.linalg.norm(np.diff(path, axis=0), axis=1)))


def energy_from_battery_j(run: Run) -> float:
    """Energy drawn from the battery, by the trapezoidal rule over the polls; NaN with fewer than two."""
    slow = run.slow_states
    if len(slow) < 2:
        return float("nan")
    power_w = -slow.battery_voltage_v * slow.battery_current_a
    return float(np.trapezoid(power_w, slow.robot_stamp_ns * NS - slow.robot_stamp_ns[0] * NS))
