"""How loads, motion and positions of one state are offset in time: one of a few conventions, chosen by the logs.

A sampled torque loop, or a simulator, computes a load from positions at the start of its step, and the step's mean
acceleration lies in the middle. Left alone, such an offset looks like a displaced weight or a wrong encoder; fitted
freely, it takes part of real effects with it. So the choice is between conventions only: all of one instant, or a load
that is older by the lag that channel *set-point to load* measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals, Residuals, feet_wrench
from diagnosis.channels.channel_view import Array, Flags

JOINT_SCALE_NM: Final = 0.4
BASE_SCALE: Final = np.array([3.0, 3.0, 5.0, 1.5, 3.0, 1.5])
"""Usual size of the residuals, so that joints and base weigh alike; N·m, N, N·m."""


@dataclass(frozen=True)
class Alignment:
    """Offsets, and the residuals without what they make."""

    load_age_s: float
    """How much older the loads are than the motion."""
    position_age_s: float
    """How much older the positions are, at which the loads acted."""
    residuals: Residuals


def aligned(signals: DynamicsSignals, swinging: Flags, calm: Flags, lag_s: float) -> Alignment:
    """Choose the convention that leaves least over swinging joints and the body's rows, and take its offsets off.

    Args:
        signals: Of channels *load to motion* and *base wrench*.
        swinging: Legs in the air at the kept rows. Shape (n, 4).
        calm: Rows away from changes of contact. Shape (n,).
        lag_s: The load's lag, by channel *set-point to load*; 0 where it is unknown.
    """
    drift = feet_wrench(signals.inputs, signals.load_rate_nm_s, signals.model.foot_radius_m).sum(axis=1)
    shifted, nominal = signals.shifted_s(), signals.nominal
    found: list[tuple[float, Alignment]] = []
    for load_s, position_s in ((0.0, 0.0), (0.5 * lag_s, lag_s)):
        residuals = Residuals(
            joint_nm=nominal.joint_nm + load_s * signals.load_rate_nm_s + position_s * shifted.joint_nm,
            base=nominal.base + load_s * drift + position_s * shifted.base,
            foot_force_n=nominal.foot_force_n,
        )
        found.append((_cost(residuals, swinging, calm), Alignment(load_s, position_s, residuals)))
    return min(found, key=lambda pair: pair[0])[1]


def _cost(residuals: Residuals, swinging: Flags, calm: Flags) -> float:
    """Mean size of the residuals, which outliers do not rule."""
    base = np.abs(residuals.base[calm] / BASE_SCALE)
    joint = np.abs(residuals.joint_nm[np.repeat(swinging, 3, axis=1)])
    every: Array = np.concatenate([base.ravel(), joint.ravel() / JOINT_SCALE_NM])
    return float(np.mean(np.minimum(every, 5.0))) if len(every) else 0.0
