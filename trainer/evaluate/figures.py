"""Figures of a recording: tracking, gait, power."""

from __future__ import annotations

from typing import Any

import numpy as np

from spot_model.robot import facts
from trainer.evaluate.rollout import Array, Recording


def tracking_error(recording: Recording, span: slice) -> Array:
    """Mean over time of |command − mean velocity over a stride|, shape (n, 3); NaN for robots that fell.

    Velocity is averaged over half a second, about a stride, so that the sway within a stride is no error.
    """
    window = round(0.5 * recording.rate_hz)
    velocity = _running_mean(recording.velocity[span], window)
    command = _running_mean(recording.command[span], window)
    error = np.abs(velocity - command).mean(axis=0)
    return np.where(recording.alive[span][-1][:, None], error, np.nan)


def mean_velocity(recording: Recording, span: slice) -> Array:
    """Mean velocity, shape (n, 3)."""
    return np.asarray(recording.velocity[span].mean(axis=0))


def gait(recording: Recording, span: slice, robot: int) -> dict[str, Any]:
    """Duty factor of each leg, their largest difference, and the share of time with no foot on the ground."""
    contact = recording.foot_contact[span, :, robot].reshape(-1, facts.N_LEGS)
    seconds = (span.stop - span.start) / recording.rate_hz
    duty = contact.mean(axis=0)
    touchdowns = (~contact[:-1] & contact[1:]).sum(axis=0)
    return {
        "duty_factors": [round(float(d), 3) for d in duty],
        "duty_spread": round(float(duty.max() - duty.min()), 3),
        "flight_share": round(float((~contact.any(axis=-1)).mean()), 3),
        "stride_hz": round(float(touchdowns.mean() / seconds), 2),
    }


def _running_mean(values: Array, window: int) -> Array:
    sums = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    return np.asarray((sums[window:] - sums[:-window]) / window)
