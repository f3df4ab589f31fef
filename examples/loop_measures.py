"""What the loop's table holds, read off logs of one policy on one robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log import Run
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.robot import facts

Array = NDArray[np.float64]

SPEEDS_M_S: Final = (3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0)
HOLD_S: Final = 10.0
MEAN_OVER_S: Final = 5.0
KNEES: Final = slice(2, None, 3)


@dataclass(frozen=True)
class Deployment:
    """How one policy did on the fake robot."""

    policy: str
    origin: str
    sustained_m_s: float
    """Highest mean speed over the last 5 s of a step of the stairs that was held for 10 s, without a fall."""
    commanded_m_s: float
    """What was asked for on that step."""
    tracking_error_m_s: float
    """Mean absolute error of the forward speed over the paper's forward sequence."""
    knee_torque_nm: float
    """Root mean square of the measured knee torques over the forward sequence."""
    knee_shortage_nm: float
    """Root mean square of what the servo law asked of the knees and the motors could not give, over that sequence."""
    ends: str
    """How forward sequence and stairs ended."""


def stairs() -> VelocitySequence:
    """Rising speeds, each held for ten seconds, with 1 m/s² between them."""
    points = [Waypoint(time_s=0.0), Waypoint(time_s=1.0)]
    time_s, before = 1.0, 0.0
    for speed in SPEEDS_M_S:
        time_s += speed - before
        points.append(Waypoint(time_s=time_s, v_x_m_s=speed, ramp=True))
        time_s, before = time_s + HOLD_S, speed
        points.append(Waypoint(time_s=time_s, v_x_m_s=speed, ramp=True))
    points.append(Waypoint(time_s=time_s + before / 2.0, ramp=True))
    return VelocitySequence(name="stairs", duration_s=points[-1].time_s + 0.5, waypoints=tuple(points))


def sustained_speed(run: Run) -> tuple[float, float]:
    """Highest mean forward speed over the last five seconds of a whole step, and that step's command; 0 without one."""
    command, speed, time_s = active(run)
    best = (0.0, 0.0)
    for wanted in SPEEDS_M_S:
        at = np.flatnonzero(np.abs(command[:, 0] - wanted) < 1e-6)
        if not len(at) or time_s[at[-1]] - time_s[at[0]] < HOLD_S - 0.1:
            break
        end_s = time_s[at[-1]]
        mean = float(speed[(time_s > end_s - MEAN_OVER_S) & (time_s <= end_s)].mean())
        best = max(best, (mean, wanted))
    return best


def tracking_error(run: Run) -> float:
    """Mean absolute error of the forward speed."""
    command, speed, _ = active(run)
    return float(np.abs(speed - command[:, 0]).mean())


def knee_torque(run: Run) -> float:
    """Root mean square over the four knees while the policy was active."""
    return float(np.sqrt(np.mean(run.states.load_nm[_active_states(run)][:, KNEES] ** 2)))


def knee_shortage(run: Run, curve: Any, position_limit: Any) -> float:
    """What the knees were asked for beyond the truth's limits, root mean square, N·m.

    Args:
        run: The log.
        curve: The truth's ``torque_speed_curve``.
        position_limit: Its ``position_torque_limit``.
    """
    from spot_model.effects.base import Motion

    rows = _active_states(run)
    index = np.minimum(np.searchsorted(run.commands.key, run.states.last_command_key[rows]), len(run.commands.key) - 1)
    position, velocity = run.states.position_rad[rows], run.states.velocity_rad_s[rows]
    request = (
        run.commands.kp_nm_per_rad[index] * (run.commands.position_rad[index] - position)
        - run.commands.kd_nm_s_per_rad[index] * velocity
    )
    motion, given = Motion(position, velocity, facts.STATE_PERIOD_NS * 1e-9), request
    for effect in (curve, position_limit):
        ready = effect.arrays_like(given)
        given, _ = ready.apply(given, motion, ready.start(given), effect.mask)
    return float(np.sqrt(np.mean((request - given)[:, KNEES] ** 2)))


def active(run: Run) -> tuple[Array, Array, Array]:
    """Velocity command, forward speed and time (from 0) of the policy's ticks."""
    rows = run.ticks.mode == "active"
    stamps = run.ticks.robot_stamp_ns[rows]
    return (
        run.ticks.velocity_command[rows],
        run.ticks.observation[rows, 0].astype(np.float64),
        (stamps - stamps[0]) * 1e-9,
    )


def _active_states(run: Run) -> NDArray[np.bool_]:
    stamps = run.ticks.robot_stamp_ns[run.ticks.mode == "active"]
    inside = (run.states.robot_stamp_ns >= stamps[0]) & (run.states.robot_stamp_ns <= stamps[-1])
    return np.asarray(inside & (run.states.last_command_key > 0))
