"""Which joint, log and two seconds the traces show: the joint with the largest gap, where it moves most."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diagnosis.read.policy_ticks import policy_ticks
from diagnosis.report.lines import SPAN_S, in_phase_s, traces
from diagnosis.verdict.diagnose import Diagnosis
from spot_log.read.run import Run


def trace_figure(result: Diagnosis, gaps: Mapping[str, float], named: frozenset[str]) -> tuple[str, str, str] | None:
    """What is shown in words, the figure, and how runs were brought in phase; None where nothing was simulated."""
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
        figure = traces(real, nominal, corrected, number, from_s)
        if figure:
            where = f"{joint} in {real.header.command_sequence or 'the log'}, repeat {real.header.repeat}"
            late = 1e3 * in_phase_s(real, nominal, number, from_s)
            return (
                where,
                figure,
                f"Simulated runs are brought in phase with the real one (your simulator by {late:.0f} ms).",
            )
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
