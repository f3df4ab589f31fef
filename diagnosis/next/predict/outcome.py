"""What is predicted of a run: numbers of its motion, and what it costs in heat and battery."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.closed_loop.run_numbers import QUANTITIES, Quantity, given_power_w, run_numbers
from spot_log.read.run import Run
from spot_model.robot import facts
from spot_model.robot.facts import Array

STATE_S: Final = facts.STATE_PERIOD_NS * 1e-9


@dataclass(frozen=True)
class Predicted(Quantity):
    """One of the numbers."""

    usual: float
    """By which simulations of walking robots are usually off, as a share of the number. Not calibrated."""


_USUAL: Final = {"top_speed": 0.04, "tracking_error": 0.15, "knee_torque": 0.08}
MOTION: Final = tuple(Predicted(q.name, q.title, q.unit, _USUAL[q.name]) for q in QUANTITIES if q.name in _USUAL)
HEAT: Final = Predicted("motor_temperature_rise", "rise of the hottest motor", "°C", 0.2)
BATTERY: Final = Predicted("battery_used", "battery used", "%", 0.2)


def motion_numbers(run: Run) -> Array:
    """:data:`MOTION` of a run, shape (3,); NaN where no policy ran for long enough."""
    numbers = run_numbers(run)
    return np.array([numbers[q.name] for q in MOTION])


def heat_and_time(run: Run) -> Array:
    """For each joint ∫τ² dt, (N·m)²·s, and the time, s; shape (12, 2)."""
    heat = (run.states.load_nm**2).sum(axis=0) * STATE_S
    return np.stack([heat, np.full(facts.N_JOINTS, len(run.states) * STATE_S)], axis=1)


def work_and_time(run: Run) -> Array:
    """Positive work of all joints, J, and the time, s; shape (2,)."""
    power_w = given_power_w(run.states.load_nm, run.states.velocity_rad_s).sum()
    return np.array([float(power_w) * STATE_S, len(run.states) * STATE_S])


def warmed_c(run: Run) -> Array:
    """How far each motor warmed up over the log, shape (12,); NaN where nobody measured it."""
    own = run.slow_states.motor_temperature_c
    return np.asarray(own[-1] - own[0]) if len(own) > 1 else np.full(facts.N_JOINTS, np.nan)


def battery_used_percent(run: Run) -> float:
    """Over the log; NaN where nobody measured it."""
    own = run.slow_states.battery_charge_percent
    return float(own[0] - own[-1]) if len(own) > 1 else float("nan")
