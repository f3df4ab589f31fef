"""Load and velocity of one joint over two seconds: real, nominal and corrected.

The joint is the one with the largest gap; the two seconds are those in which it moves most.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from diagnosis.channels.channel_view import Array
from diagnosis.read.policy_ticks import policy_ticks
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.svg import line, nice_ticks, svg, text, thinned
from spot_log.read.run import Run

WIDTH: Final = 560
PANEL: Final = 190
LEFT: Final = 60
SPAN_S: Final = 2.0
MAX_POINTS: Final = 700
LONGEST_SHIFT_S: Final = 0.5


def trace_figures(result: Diagnosis, gaps: Mapping[str, float], named: frozenset[str]) -> tuple[str, list[str]] | None:
    """What is shown in words, and the figures; None where nothing was simulated."""
    if not result.simulated.get("nominal"):
        return None
    joints = result.board.robot.joint_names
    pool = [j for j in joints if j in named] or list(joints)
    joint = max(pool, key=lambda j: gaps.get(j, 0.0))
    for real in result.runs:
        nominal, corrected = (_same(real, result.simulated[name]) for name in ("nominal", "corrected"))
        if nominal is None or len(policy_ticks(real)) == 0:
            continue
        number = joints.index(joint)
        from_s = _liveliest_s(real, number)
        figures = traces(real, nominal, corrected, number, from_s)
        if figures:
            late = 1e3 * in_phase_s(real, nominal, number, from_s)
            about = (
                f"{joint} in {real.header.command_sequence or 'the log'}, repeat {real.header.repeat}. Simulated runs "
                f"are brought in phase with the real one (your simulator by {late:.0f} ms)."
            )
            return about, figures
    return None


def _same(real: Run, group: tuple[Run, ...]) -> Run | None:
    key = (real.header.command_sequence or "unnamed", real.header.repeat)
    return next((r for r in group if (r.header.command_sequence, r.header.repeat) == key), None)


def _liveliest_s(run: Run, joint: int) -> float:
    """Begin of the stretch in which the joint moves most, time under the policy."""
    rows = policy_ticks(run)
    time_s = (run.states.robot_stamp_ns - run.ticks.robot_stamp_ns[rows[0]]) * 1e-9
    last_s = float((run.ticks.robot_stamp_ns[rows[-1]] - run.ticks.robot_stamp_ns[rows[0]]) * 1e-9)
    starts = np.arange(0.0, max(last_s - SPAN_S, 0.0) + 0.25, 0.5)
    speed = np.nan_to_num(run.states.velocity_rad_s[:, joint]) ** 2
    energy = [float(speed[(time_s >= s) & (time_s < s + SPAN_S)].sum()) for s in starts]
    return float(starts[int(np.argmax(energy))])


def traces(real: Run, nominal: Run | None, corrected: Run | None, joint: int, from_s: float) -> list[str]:
    """Load and velocity of one joint over two seconds, a figure each; none where a run lacks them.

    Args:
        real: A log.
        nominal: The nominal model's run of the same commands.
        corrected: The corrected model's.
        joint: Number of the joint.
        from_s: Time under the policy at which the picture begins.
    """
    runs = [("var(--nominal)", 1.6, nominal), ("var(--corrected)", 1.6, corrected), ("var(--real)", 2.0, real)]
    figures = []
    for title, name in (("load, N·m", "load_nm"), ("velocity, rad/s", "velocity_rad_s")):
        drawn = []
        for colour, width, run in runs:
            if run is not None:
                shift = in_phase_s(real, run, joint, from_s)
                at, values = _part(run, name, joint, from_s + shift)
                drawn.append((colour, width, at - shift, values))
        drawn = [d for d in drawn if len(d[2])]
        if not drawn:
            return []
        both = np.concatenate([d[3] for d in drawn])
        pad = 0.06 * max(float(np.ptp(both)), 1e-9)
        low, high = float(both.min()) - pad, float(both.max()) + pad
        parts = [_axes(title, low, high, from_s)]
        for colour, width, at, values in drawn:
            x, y = _x(at, from_s), _y(values, low, high)
            parts.append(line(list(zip(x.tolist(), y.tolist(), strict=True)), colour, width))
        figures.append(svg(WIDTH, PANEL + 50, parts, f"Real, nominal and corrected: {title}"))
    return figures


def in_phase_s(real: Run, other: Run, joint: int, from_s: float) -> float:
    """Time by which the other run's steps come later than the real one's around the picture, s; positions correlate."""
    at, wanted = _part(real, "position_rad", joint, from_s)
    rows = policy_ticks(other)
    if len(at) < 2 or len(rows) == 0:
        return 0.0
    time_s = (other.states.robot_stamp_ns - other.ticks.robot_stamp_ns[rows[0]]) * 1e-9
    values = np.nan_to_num(other.states.position_rad[:, joint])
    shifts = np.arange(-LONGEST_SHIFT_S, LONGEST_SHIFT_S, 0.005)
    inside = [s for s in shifts if time_s[0] <= at[0] + s and at[-1] + s <= time_s[-1]] or [0.0]
    moved = np.stack([np.interp(at + s, time_s, values) for s in inside])
    moved -= moved.mean(axis=1, keepdims=True)
    fit = moved @ (wanted - wanted.mean()) / np.maximum(np.linalg.norm(moved, axis=1), 1e-9)
    return float(inside[int(np.argmax(fit))])


def _part(run: Run, name: str, joint: int, from_s: float) -> tuple[Array, Array]:
    rows = policy_ticks(run)
    if len(rows) == 0:
        return np.zeros(0), np.zeros(0)
    time_s = (run.states.robot_stamp_ns - run.ticks.robot_stamp_ns[rows[0]]) * 1e-9
    part = np.flatnonzero((time_s >= from_s) & (time_s < from_s + SPAN_S))
    part = part[thinned(part, MAX_POINTS)]
    values = getattr(run.states, name)[part, joint]
    good = np.isfinite(values)
    return time_s[part][good], values[good]


def _x(at_s: Array, from_s: float) -> Array:
    return np.asarray(LEFT + (at_s - from_s) / SPAN_S * (WIDTH - LEFT - 12))


def _y(values: Array, low: float, high: float) -> Array:
    return np.asarray(8 + PANEL * (high - values) / (high - low))


def _axes(title: str, low: float, high: float, from_s: float) -> str:
    parts = [f'<rect class="grid" x="{LEFT}" y="8" width="{WIDTH - LEFT - 12}" height="{PANEL}"/>']
    for tick in nice_ticks(low, high, 4):
        y = float(_y(np.array(tick), low, high))
        parts.append(line([(LEFT, y), (WIDTH - 12, y)], "var(--line)", 1))
        parts.append(text(LEFT - 8, y + 4, f"{tick:g}", size=12.5, anchor="end", css="soft"))
    for tick in nice_ticks(from_s, from_s + SPAN_S, 5):
        x = float(_x(np.array(tick), from_s))
        parts.append(text(x, PANEL + 24, f"{tick:g}", size=12.5, anchor="middle", css="soft"))
    name = text(0, 0, title, size=13, anchor="middle")
    parts.append(f'<g transform="translate(14 {8 + PANEL / 2:.0f}) rotate(-90)">{name}</g>')
    parts.append(text(WIDTH / 2, PANEL + 44, "time under the policy, s", size=13, anchor="middle", css="soft"))
    return "".join(parts)
