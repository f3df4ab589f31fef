"""What a run came to, in the few numbers that a person asks for: of logs and of simulated runs alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from diagnosis.channels import Ints
from spot_log.read.run import Run
from spot_model.robot.facts import Array
from spot_model.robot.rotation import rotate_inverse_wxyz, tilt_rad
from trainer.signals.policy_ticks import fall_stamp_ns, policy_ticks

HELD_S: Final = 1.0
"""A top speed was held for so long."""
KNEE_SHARE: Final = 0.99
"""Share of the time that the knees' torque lies below the reported one: single peaks are noise of the load cells."""


@dataclass(frozen=True)
class Quantity:
    """One of the numbers."""

    name: str
    title: str
    unit: str


QUANTITIES: Final = (
    Quantity("top_speed", f"top speed, held for {HELD_S:g} s", "m/s"),
    Quantity("mean_speed", "mean forward speed", "m/s"),
    Quantity("tracking_error", "mean error of the forward speed", "m/s"),
    Quantity("power", "mechanical power, mean of what the joints give", "W"),
    Quantity("knee_torque", f"knee torque, {100 * KNEE_SHARE:g} % of the time below", "N·m"),
    Quantity("lean", "largest lean of the body", "rad"),
)
"""Numbers of one run; falls are those of many, see :func:`restricted_mean_s`."""


class WalkTime(NamedTuple):
    """How long a robot followed its policy."""

    time_s: float
    """To its fall, or to the end of the run."""
    has_fallen: bool


def run_numbers(run: Run) -> Mapping[str, float]:
    """:data:`QUANTITIES` of a run, by name; NaN where no policy ran for :data:`HELD_S`, or the log lacks the signal."""
    s, ticks, stamps_ns = run.states, run.ticks, run.states.robot_stamp_ns
    followed_ns = ticks.robot_stamp_ns[policy_ticks(run)]
    first, last = np.searchsorted(stamps_ns, [followed_ns[0], followed_ns[-1] + 1]) if len(followed_ns) else (0, 0)
    rows = slice(first, last)
    period_s = float(np.median(np.diff(stamps_ns))) * 1e-9 if len(s) > 1 else np.inf
    if (last - first) * period_s < HELD_S:
        return {q.name: float("nan") for q in QUANTITIES}
    attitude, load = s.odom_from_body_wxyz[rows], s.load_nm[rows]
    velocity = np.asarray(rotate_inverse_wxyz(attitude, s.linear_vel_of_body_in_odom_m_s[rows]))[:, 0]
    window = min(round(HELD_S / period_s), len(velocity))
    total = np.concatenate([[0.0], np.cumsum(velocity)])
    at = np.clip(np.searchsorted(ticks.robot_stamp_ns, stamps_ns[rows], side="right") - 1, 0, len(ticks) - 1)
    return {
        "top_speed": float(np.max(total[window:] - total[:-window]) / window),
        "mean_speed": float(velocity.mean()),
        "tracking_error": float(np.mean(np.abs(ticks.velocity_command[at, 0] - velocity))),
        "power": float(given_power_w(load, s.velocity_rad_s[rows]).mean()),
        "knee_torque": float(np.quantile(np.abs(load[:, 2::3]).max(axis=1), KNEE_SHARE)),
        "lean": float(np.max(tilt_rad(attitude))),
    }


def given_power_w(load_nm: Array, velocity_rad_s: Array) -> Array:
    """What the joints give; what they take back is lost. Shapes (n, J) to (n,)."""
    return np.asarray(np.maximum(load_nm * velocity_rad_s, 0.0).sum(axis=1))


def time_to_fall(run: Run) -> WalkTime | None:
    """How long the robot followed the policy, and whether it fell then; None where no policy ran."""
    rows = policy_ticks(run, at_least=1)
    if len(rows) == 0:
        return None
    stamps, fall_ns = run.ticks.robot_stamp_ns[rows], fall_stamp_ns(run)
    end_ns = stamps[-1] if fall_ns is None else fall_ns
    return WalkTime(float(end_ns - stamps[0]) * 1e-9, fall_ns is not None)


def restricted_mean_s(lasted: Sequence[WalkTime], length_s: float, counts: Ints) -> Array:
    """Mean time to a fall within a command's length, by the Kaplan-Meier estimate of the share that still walks.

    A run that ended without a fall counts as long as it lasted; after the last fall the share stays. Each run counts
    so often, (..., number of runs) to (...).

    Source: Royston and Parmar, BMC Medical Research Methodology 13:152 (2013).
    """
    time_s, has_fallen = (np.array([getattr(one, name) for one in lasted]) for name in WalkTime._fields)
    area_s, share, at_s = np.zeros(counts.shape[:-1]), np.ones(counts.shape[:-1]), 0.0
    for fall_s in sorted({one.time_s for one in lasted if one.has_fallen and one.time_s < length_s}):
        area_s = area_s + share * (fall_s - at_s)
        share = share * (1.0 - counts @ (has_fallen & (time_s == fall_s)) / np.maximum(counts @ (time_s >= fall_s), 1))
        at_s = fall_s
    return np.asarray(area_s + share * (length_s - at_s))


def known_mean(values: Array) -> Array:
    """Mean over the first axis of what is finite; NaN where nothing is."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
