"""The loop's page: before, after and oracle side by side, and the paper's own figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from loop_measures import KNEES, MEAN_OVER_S, Array, Deployment, active_states, steps_of

from spot_log import Run
from spot_log.page.charts import stance
from spot_log.page.render import rendered
from spot_log.page.sections import Beside, Chart, Content, Head, Legend, Mark, Section, Series, Table
from spot_model.effects.base import Motion
from spot_model.effects.torque_limits import TorqueLimit, TorqueSpeedCurve
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from spot_model.robot.gait import measure_gait

COLOURS: Final = {"before": "var(--unknown)", "after": "var(--floor)", "oracle": "var(--good)"}
PAPER_BEFORE_M_S, PAPER_AFTER_M_S = 3.8, 5.2
PAPER: Final = "Miller et al. 2025, arXiv 2504.17857"
OF_ORACLE: Final = 0.95
OVER_BEFORE: Final = 1.30
STANDS_M_S: Final = 0.1
"""A robot that is told to stand and is slower stands."""
STRIDES_S: Final = 0.9
SPEEDS_RAD_S: Final = np.arange(-20.5, 21.0, 1.0)
FEWEST: Final = 30
"""Samples in a bin of knee speed from which its extremes are drawn."""


@dataclass(frozen=True)
class Walked:
    """A policy's row of the table, and its climb of the stairs."""

    row: Deployment
    climb: Run


def loop_page(robot: str, truth: RobotModel, walked: Sequence[Walked]) -> str:
    """The page's text.

    Args:
        robot: Its name.
        truth: Its effects, for the knees' limits.
        walked: Before, and what there is of after and oracle.
    """
    rows = {one.row.policy: one.row for one in walked}
    asked, is_met = verdict(robot, rows)
    badge = ("as asked", "good") if is_met else ("not as asked", "bad")
    if "after" not in rows:
        badge = ("before", "none")
    before, after = rows["before"], rows.get("after")
    headline = f"{robot}: {before.held_m_s:.2f} m/s before"
    if after is not None:
        headline += f", {after.held_m_s:.2f} m/s after"
    speeds = Legend([(COLOURS[name], name) for name in rows])
    body = [
        Head(*badge, headline, asked),
        Section(
            "Before, after, oracle",
            "Highest mean speed over the last 5 s of a step of 10 s; error and cost of transport (positive mechanical "
            "work over weight and distance) over the forward sequence; error of the turn rate, and falls, in "
            "random walks with jumps of the command.",
            _table(list(rows.values())),
        ),
        Beside(
            [
                Section("Speed against command", "Dotted: as commanded.", [speeds, _speeds(walked)]),
                Section(
                    "Knee torque against knee speed",
                    "Extremes (1 and 99 %) of the load at each policy's highest speed. Dotted: what the motors can "
                    "give; the load sensor also feels the rotor's inertia.",
                    [speeds, _torques(walked, truth)],
                ),
            ]
        ),
        Section("Feet on the ground", "At each policy's highest speed.", list(map(_gait, walked))),
        Section(
            "In the paper, on a real Spot",
            f"{PAPER}, sections on results and robustness.",
            Table(
                ["", "before", "after", "ratio"],
                [
                    ["highest speed, m/s", PAPER_BEFORE_M_S, PAPER_AFTER_M_S, PAPER_AFTER_M_S / PAPER_BEFORE_M_S],
                    ["flight phases", "failed", "a flying trot", ""],
                ],
            ),
        ),
    ]
    return rendered(f"The loop: {robot}", body)


def verdict(robot: str, rows: dict[str, Deployment]) -> tuple[list[str], bool]:
    """What was asked of *after*, each with what was measured, and whether all of it holds."""
    before, after, oracle = rows["before"], rows.get("after"), rows.get("oracle")
    if after is None:
        return ["There is no policy after: the improvement changed nothing, or was not made."], False
    speed = f"{_ratio(after.held_m_s, before.held_m_s)} times its speed"
    falls = f"{after.falls} falls in {after.walks} walks, {before.falls} before"
    rest = f"{after.standing_m_s:.2f} m/s when told to stand"
    is_as_good = after.held_m_s >= before.held_m_s and after.falls <= before.falls and after.standing_m_s < STANDS_M_S
    told = [(f"not slower and not less stable than before: {speed}, {falls}, {rest}", is_as_good)]
    if robot == "paper":
        papers = f"the paper: {PAPER_AFTER_M_S / PAPER_BEFORE_M_S:.2f}"
        is_faster = after.held_m_s >= OVER_BEFORE * before.held_m_s
        told.append((f"at least {OVER_BEFORE:.2f} times as fast as before: {speed} ({papers})", is_faster))
    if oracle is not None:
        share = _ratio(after.held_m_s, oracle.held_m_s)
        is_near = after.held_m_s >= OF_ORACLE * oracle.held_m_s
        told.append((f"at least {OF_ORACLE:.2f} of the oracle's speed: {share}", is_near))
    return [f"{'Met' if met else 'Not met'}: {words}." for words, met in told], all(met for _, met in told)


def _ratio(over: float, under: float) -> str:
    return f"{over / under:.3f}" if under > 0.0 else "no number, as the other held no step,"


def _table(rows: Sequence[Deployment]) -> Table:
    before = rows[0]
    return Table(
        [
            "",
            "speed held, m/s",
            "commanded, m/s",
            "over before",
            "error, m/s",
            "cost of transport",
            "speed at rest, m/s",
            "turning error, rad/s",
            "falls",
            "stairs",
        ],
        [
            [
                r.policy,
                r.held_m_s,
                r.commanded_m_s,
                _ratio(r.held_m_s, before.held_m_s),
                r.tracking_error_m_s,
                r.cost_of_transport,
                r.standing_m_s,
                r.turning_error_rad_s,
                f"{r.falls} of {r.walks}",
                r.stairs_end,
            ]
            for r in rows
        ],
    )


def _speeds(walked: Sequence[Walked]) -> Chart:
    drawn, top = [], 0.0
    for one in walked:
        steps = steps_of(one.climb)
        asked, held = [s.commanded_m_s for s in steps], [s.held_m_s for s in steps]
        top = max([top, *asked])
        drawn.append(Series(COLOURS[one.row.policy], asked, held, has_points=True, name=one.row.policy))
    ideal = Series("var(--ink)", [0.0, top], [0.0, top], width=1.0, is_dotted=True)
    return Chart([ideal, *drawn], "held, m/s", x_title="commanded, m/s", height=260, zero=True)


def _torques(walked: Sequence[Walked], truth: RobotModel) -> Chart:
    middle = 0.5 * (SPEEDS_RAD_S[1:] + SPEEDS_RAD_S[:-1])
    drawn = [Series("var(--ink)", middle, bound, width=1.0, is_dotted=True) for bound in knee_bounds(truth, middle)]
    for one in walked:
        rows = _at_top(one, MEAN_OVER_S)
        if rows is None:
            continue
        speed, torque = one.climb.states.velocity_rad_s[rows][:, KNEES], one.climb.states.load_nm[rows][:, KNEES]
        number = np.digitize(speed, SPEEDS_RAD_S) - 1
        bins = [torque[number == i] for i in range(len(middle))]
        for percent in (1, 99):
            ends = [float(np.percentile(b, percent)) if len(b) >= FEWEST else np.nan for b in bins]
            drawn.append(Series(COLOURS[one.row.policy], middle, ends))
    return Chart(drawn, "N·m", x_title="knee speed, rad/s", height=260)


def knee_bounds(truth: RobotModel, speed_rad_s: Array) -> tuple[Array, Array]:
    """The largest and the least torque that the limits by speed leave a knee, each the shape of the speeds, N·m."""
    knee = facts.JOINT_NAMES.index("fr_kn")
    velocity = np.tile(np.asarray(speed_rad_s, dtype=np.float64)[:, None], (1, facts.N_JOINTS))
    motion = Motion(np.tile(facts.DEFAULT_POSITION_RAD, (len(velocity), 1)), velocity, 1e-3)
    bounds = []
    for sign in (1.0, -1.0):
        torque = np.full_like(velocity, sign * 1e3)
        for effect in truth.effects:
            if isinstance(effect, (TorqueLimit, TorqueSpeedCurve)):
                ready = effect.arrays_like(torque)
                torque, _ = ready.apply(torque, motion, ready.start(torque), effect.mask)
        bounds.append(np.asarray(torque[:, knee]))
    return bounds[0], bounds[1]


def _gait(one: Walked) -> Content:
    rows, longer = _at_top(one, STRIDES_S), _at_top(one, MEAN_OVER_S)
    if rows is None or longer is None:
        return None
    states = one.climb.states
    gait = measure_gait(states.robot_stamp_ns[longer] * 1e-9, states.foot_contact[longer])
    words = f"{one.row.policy}, {one.row.held_m_s:.2f} m/s: {gait.sentence()}"
    feet = stance(states.foot_contact[rows], facts.LEG_NAMES, COLOURS[one.row.policy], (0.0, STRIDES_S))
    return [Mark(words, "note"), feet]


def _at_top(one: Walked, span_s: float) -> Array | None:
    """The states at the end of the fastest step, as a mask; None where no step was held."""
    best = max(steps_of(one.climb), key=lambda step: step.held_m_s, default=None)
    return None if best is None else active_states(one.climb, until=best.end, span_s=span_s)
