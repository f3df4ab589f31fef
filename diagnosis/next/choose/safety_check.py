"""Whether an experiment is safe on every robot that is still possible: what is refused, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from diagnosis.closed_loop.run_numbers import given_power_w
from diagnosis.next.choose.trial import STAND_S, STATE_S
from spot_log.read.run import Run
from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import rotate_wxyz, tilt_rad

TILT_RAD: Final = 0.6
"""The safety core stops at 0.785."""
HEIGHT_M: Final = 0.28
"""Body over its lowest sole; the safety core stops at 0.25 m."""
SPEED_RAD_S: Final = 25.0
"""Of a joint, where the knee's motor gives no more torque; the robot itself stops at 40."""
LOAD_NM: Final = np.tile([50.0, 50.0, 115.0], facts.N_LEGS)
"""The joints' limits are 45 and 113 N·m; the rest is noise of the cells."""
STOP_MARGIN_RAD: Final = 0.05
"""A joint measured this far beyond its stop was pressed against it."""


def refusals(runs: Sequence[Run]) -> tuple[str, ...]:
    """Why an experiment must not be run, a sentence each; none where the robots of all runs bear it."""
    found: dict[str, list[float]] = {}
    for run in runs:
        for words, value in _wrong(run):
            found.setdefault(words, []).append(value)
    return tuple(
        f"{len(values)} of {len(runs)} simulated robots {words.format(max(values, key=abs))}"
        for words, values in found.items()
    )


def _wrong(run: Run) -> Iterator[tuple[str, float]]:
    s = run.states
    rows = s.robot_stamp_ns >= s.robot_stamp_ns[0] + round(0.5 * STAND_S * 1e9)
    position, velocity, load = s.position_rad[rows], s.velocity_rad_s[rows], s.load_nm[rows]
    attitude = s.odom_from_body_wxyz[rows]
    if not all(np.isfinite(a).all() for a in (position, velocity, load, attitude)):
        yield "break their simulation", 0.0
        return
    tilt = np.asarray(tilt_rad(attitude))
    feet = np.asarray(rotate_wxyz(attitude[:, None, :], np.asarray(foot_position_in_body_m(position))))
    height = facts.FOOT_RADIUS_M - feet[..., 2].min(axis=1)
    if tilt.max() > TILT_RAD:
        yield f"tip over or lean by {{:.2f}} rad (allowed: {TILT_RAD})", float(tilt.max())
        return
    if height.min() < HEIGHT_M:
        yield f"sink to {{:.2f}} m (allowed: {HEIGHT_M} m)", float(height.min())
    if np.abs(velocity).max() > SPEED_RAD_S:
        yield f"move a joint at {{:.0f}} rad/s (allowed: {SPEED_RAD_S:g})", float(np.abs(velocity).max())
    over = np.abs(load) / LOAD_NM
    if over.max() > 1.0:
        yield "load a joint with {:.0f} % of what it may carry", float(100.0 * over.max())
    beyond = np.maximum(facts.POSITION_LOW_RAD - position, position - facts.POSITION_HIGH_RAD).max()
    if beyond > STOP_MARGIN_RAD:
        yield f"press a joint {{:.2f}} rad into its stop (allowed: {STOP_MARGIN_RAD})", float(beyond)


def burden(runs: Sequence[Run]) -> str:
    """What an experiment loads on the robot, in words: the largest of all simulated robots."""
    knee = max(float(np.abs(r.states.load_nm[:, 2::3]).max()) for r in runs)
    speed = max(float(np.abs(r.states.velocity_rad_s).max()) for r in runs)
    work_j = max(given_power_w(r.states.load_nm, r.states.velocity_rad_s).sum() for r in runs) * STATE_S
    return f"knee up to {knee:.0f} N·m, joints up to {speed:.1f} rad/s, {work_j / 1e3:.1f} kJ of work"
