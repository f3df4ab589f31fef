"""What a run came to, in the few numbers that a person asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.read.policy_ticks import policy_ticks
from spot_log.read.run import Run
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import rotate_inverse_wxyz

HELD_S: Final = 1.0
"""A top speed was held for so long."""
STATE_S: Final = facts.STATE_PERIOD_NS * 1e-9


@dataclass(frozen=True)
class Quantity:
    """One of the numbers."""

    name: str
    title: str
    unit: str
    usual: float
    """By which simulations of walking robots are usually off, as a share of the number. Not calibrated."""


MOTION: Final = (
    Quantity("top_speed", f"top speed, held for {HELD_S:g} s", "m/s", 0.04),
    Quantity("tracking_error", "mean error of the forward speed", "m/s", 0.15),
    Quantity("knee_torque", "knee torque, 99 % of the time below", "N·m", 0.08),
)
HEAT: Final = Quantity("motor_temperature_rise", "rise of the hottest motor", "°C", 0.2)
BATTERY: Final = Quantity("battery_used", "battery used", "%", 0.2)


def followed_rows(run: Run) -> NDArray[np.intp]:
    """States while the policy followed the command, by number."""
    ticks = policy_ticks(run)
    if len(ticks) == 0:
        return np.zeros(0, dtype=np.intp)
    stamps = run.ticks.robot_stamp_ns[ticks]
    s = run.states.robot_stamp_ns
    return np.flatnonzero((s >= stamps[0]) & (s <= stamps[-1]))


def motion_numbers(run: Run) -> Array:
    """:data:`MOTION` of a run, shape (3,); NaN where no policy ran for :data:`HELD_S`."""
    rows = followed_rows(run)
    s = run.states
    if len(rows) * STATE_S < HELD_S:
        return np.full(len(MOTION), np.nan)
    velocity = np.asarray(rotate_inverse_wxyz(s.odom_from_body_wxyz[rows], s.linear_vel_of_body_in_odom_m_s[rows]))[
        :, 0
    ]
    window = min(round(HELD_S / STATE_S), len(velocity))
    total = np.concatenate([[0.0], np.cumsum(velocity)])
    top = float(np.max(total[window:] - total[:-window]) / window)
    ticks = run.ticks
    at = np.clip(np.searchsorted(ticks.robot_stamp_ns, s.robot_stamp_ns[rows], side="right") - 1, 0, len(ticks) - 1)
    error = float(np.mean(np.abs(ticks.velocity_command[at, 0] - velocity)))
    knee = float(np.quantile(np.abs(s.load_nm[rows][:, 2::3]).max(axis=1), 0.99))
    return np.array([top, error, knee])


def heat_and_time(run: Run) -> Array:
    """For each joint ∫τ² dt, (N·m)²·s, and the time, s; shape (12, 2)."""
    heat = (run.states.load_nm**2).sum(axis=0) * STATE_S
    return np.stack([heat, np.full(facts.N_JOINTS, len(run.states) * STATE_S)], axis=1)


def work_and_time(run: Run) -> Array:
    """Positive work of all joints, J, and the time, s; shape (2,)."""
    power = np.maximum(run.states.load_nm * run.states.velocity_rad_s, 0.0).sum()
    return np.array([float(power) * STATE_S, len(run.states) * STATE_S])


def warmed_c(run: Run) -> Array:
    """How far each motor warmed up over the log, shape (12,); NaN where nobody measured it."""
    own = run.slow_states.motor_temperature_c
    return np.asarray(own[-1] - own[0]) if len(own) > 1 else np.full(facts.N_JOINTS, np.nan)


def battery_used_percent(run: Run) -> float:
    """Over the log; NaN where nobody measured it."""
    own = run.slow_states.battery_charge_percent
    return float(own[0] - own[-1]) if len(own) > 1 else float("nan")
