"""Load and velocity of one joint over two seconds: real, nominal and corrected.

The joint is the one with the largest gap; the two seconds are those in which it moves most.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from diagnosis.channels import Array
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.page.chart import Series, chart
from spot_log.page.svg import HALF, liveliest, thinned
from spot_log.read.run import Run
from trainer.signals.policy_ticks import policy_ticks

SPAN_S: Final = 2.0
MAX_POINTS: Final = 700
LONGEST_SHIFT_S: Final = 0.5


def trace_figures(result: Diagnosis, gaps: Mapping[str, float], named: frozenset[str]) -> tuple[str, list[str]] | None:
    """What is shown in words, and the figures; None where nothing was simulated."""
    joints = result.board.robot.joint_names
    name = max([j for j in joints if j in named] or joints, key=lambda j: gaps.get(j, 0.0))
    joint = joints.index(name)
    for real in result.runs:
        nominal, corrected = (_same(real, result.simulated.get(model, ())) for model in ("nominal", "corrected"))
        time_s = _time_s(real)
        if nominal is None or time_s is None:
            continue
        from_s = _liveliest_s(real, time_s, joint)
        drawn = [("var(--nominal)", 1.6, nominal), ("var(--corrected)", 1.6, corrected), ("var(--real)", 2.0, real)]
        shifted = [(c, w, run, in_phase_s(real, run, joint, from_s)) for c, w, run in drawn if run is not None]
        figures = []
        for title, signal in (("load, N·m", "load_nm"), ("velocity, rad/s", "velocity_rad_s")):
            lines = []
            for colour, width, run, shift in shifted:
                at, values = _part(run, signal, joint, from_s + shift)
                lines += [Series(colour, at - shift, values, width=width)] if len(values) else []
            figures.append(chart(lines, title, x_title="time under the policy, s", width=HALF))
        if all(figures):
            about = (
                f"{name} in {real.header.command_sequence or 'the log'}, repeat {real.header.repeat}. Simulated runs "
                f"are brought in phase with the real one (the nominal model by {1e3 * shifted[0][-1]:.0f} ms)."
            )
            return about, figures
    return None


def _same(real: Run, group: tuple[Run, ...]) -> Run | None:
    key = (real.header.command_sequence or "unnamed", real.header.repeat)
    return next((r for r in group if (r.header.command_sequence, r.header.repeat) == key), None)


def _time_s(run: Run) -> Array | None:
    """Time of each state under the policy; None where none ran."""
    rows = policy_ticks(run)
    return (run.states.robot_stamp_ns - run.ticks.robot_stamp_ns[rows[0]]) * 1e-9 if len(rows) else None


def _liveliest_s(run: Run, time_s: Array, joint: int) -> float:
    """Begin of the stretch in which the joint moves most, time under the policy."""
    stamps_ns = run.ticks.robot_stamp_ns[policy_ticks(run)]
    inside = np.flatnonzero((time_s >= 0.0) & (time_s <= float(stamps_ns[-1] - stamps_ns[0]) * 1e-9))
    if not len(inside):
        return 0.0
    length = int(np.searchsorted(time_s[inside], time_s[inside[0]] + SPAN_S))
    return float(time_s[inside][liveliest(run.states.velocity_rad_s[inside, joint] ** 2, length).start])


def in_phase_s(real: Run, other: Run, joint: int, from_s: float) -> float:
    """Time by which the other run's steps come later than the real one's around the picture, s; positions correlate."""
    at, wanted = _part(real, "position_rad", joint, from_s)
    time_s = _time_s(other)
    if len(at) < 2 or time_s is None:
        return 0.0
    values = np.nan_to_num(other.states.position_rad[:, joint])
    shifts = np.arange(-LONGEST_SHIFT_S, LONGEST_SHIFT_S, 0.005)
    inside = [s for s in shifts if time_s[0] <= at[0] + s and at[-1] + s <= time_s[-1]] or [0.0]
    moved = np.stack([np.interp(at + s, time_s, values) for s in inside])
    moved -= moved.mean(axis=1, keepdims=True)
    fit = moved @ (wanted - wanted.mean()) / np.maximum(np.linalg.norm(moved, axis=1), 1e-9)
    return float(inside[int(np.argmax(fit))])


def _part(run: Run, name: str, joint: int, from_s: float) -> tuple[Array, Array]:
    """Times and values of one signal in the picture."""
    time_s = _time_s(run)
    if time_s is None:
        return np.zeros(0), np.zeros(0)
    part = np.flatnonzero((time_s >= from_s) & (time_s < from_s + SPAN_S))
    part = part[thinned(part, MAX_POINTS)]
    values = getattr(run.states, name)[part, joint]
    good = np.isfinite(values)
    return time_s[part][good], values[good]
