"""Figures of a recording: tracking, gait, power."""

from __future__ import annotations

from typing import Any

import numpy as np

from spot_model.robot import facts
from spot_model.robot.gait import measure_gait
from trainer.simulate.recording import Array, Recording


def tracking_error(recording: Recording, span: slice) -> Array:
    """Mean over time of |command − mean velocity over a stride|, shape (n, 3); NaN for robots that fell.

    Velocity is averaged over half a second, about a stride, so that sway within a stride is not an error.
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
    """The gait of one robot; see :class:`spot_model.robot.gait.Gait`."""
    contact = recording.foot_contact[span, :, robot].reshape(-1, facts.N_LEGS)
    descent = recording.foot_descent_m_s[span, :, robot].reshape(-1, facts.N_LEGS)
    step_s = 1.0 / (recording.rate_hz * recording.foot_contact.shape[1])
    measured = measure_gait(step_s * np.arange(len(contact)), contact, descent)
    return {
        "gait": measured.name,
        "clarity": round(measured.clarity, 3),
        "stride_hz": round(measured.stride_hz, 2),
        "duty_factors": [round(d, 3) for d in measured.duty],
        "duty_spread": round(max(measured.duty) - min(measured.duty), 3),
        "flight_share": round(measured.flight_share, 3),
        "phases": [None if np.isnan(p) else round(p, 3) for p in measured.phase],
        "agreement": {name: round(share, 3) for name, share in measured.agreement.items()},
        "diagonals_agree": round(measured.diagonals_agree, 3),
        "others_agree": round(measured.others_agree, 3),
        "touchdown_m_s": None if np.isnan(measured.touchdown_m_s) else round(measured.touchdown_m_s, 3),
    }


def _running_mean(values: Array, window: int) -> Array:
    sums = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    return np.asarray((sums[window:] - sums[:-window]) / window)
