"""Whether something is there that no effect of the library is: what the corrected model leaves beyond the usual.

Of the residuals, by channel: the signal of which most is left beyond noise and what formulas leave. Of closed loops, by
gap: what is left over the larger of the robot's own repeats and a practical size. Each is compared with what corrected
models of robots without a fault leave; the smallest p value, times the number of comparisons, decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.decision_constants import FORMULA_ERROR
from diagnosis.document import UnknownEffect
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.faultless import FAULTLESS
from diagnosis.selection.scoring import Scored, Scorer
from diagnosis.verdict.left_over import SMALLEST, over_usual
from diagnosis.verdict.measured import Measurements

CARRIES: Final = 0.5
"""Signals with this share of the most that is left carry it, too."""


def gaps_left(measured: Measurements) -> dict[str, float]:
    """By gap of the closed loop, the logarithm of what the corrected model leaves over what it may.

    That is the gap's floor, and a share of what the differences close: their formulas are not the robot's.
    """
    if measured.whole.loop != "closed" or measured.calibration is None:
        return {}
    before = {g.gap: g.after for g in measured.calibration.gaps}
    found = {}
    for g in measured.left:
        may = float(np.hypot(g.floor, FORMULA_ERROR * max(before.get(g.gap, g.left) - g.left, 0.0)))
        found[g.gap] = float(np.log(max(g.left / may, SMALLEST))) if may > 0.0 else 0.0
    return {str(gap): value for gap, value in found.items()}


def describe_unknown(board: Evidence, scored: Scored, found: Mapping[str, float]) -> UnknownEffect | None:
    """Where it is: the channel that stands out most, its joints and the part of the motion; None where none does."""
    known = {c: FAULTLESS.left[str(c)] for c in board.by_channel if str(c) in FAULTLESS.left and str(c) in found}
    if not known:
        return None
    channel = min(known, key=lambda c: known[c].tail(found[str(c)]))
    over, numbers, view = np.exp(over_usual(board, scored)), np.array(board.by_channel[channel]), board.views[channel]
    units = np.array([view.unit_of(board.blocks[n].row) for n in numbers])
    unit = units[np.argmax(over[numbers])]
    chosen = numbers[(over[numbers] >= CARRIES * over[numbers].max()) & (units == unit)]
    residuals = Scorer(board, scored.terms).residuals()
    joints = np.zeros(board.robot.n_joints, dtype=np.bool_)
    for n in chosen:
        row = board.blocks[n].row
        joints |= np.arange(len(joints)) == view.row_joint[row]
        if view.row_joint[row] < 0 <= view.row_leg[row]:
            joints |= view.leg_of_joint == view.row_leg[row]
    noise = np.array([board.blocks[n].noise for n in chosen])
    usual = np.exp(known[channel].at(0.05)) * scored.left[chosen] / over[chosen]
    return UnknownEffect(
        joints=board.robot.named(joints),
        regime=_regime(view, board, chosen, residuals),
        channel=channel,
        unit=str(unit),
        left=float(np.sqrt(np.mean(noise**2 * scored.left[chosen]))),
        usual=float(np.sqrt(np.mean(noise**2 * usual))),
    )


def _regime(view: ChannelView, board: Evidence, chosen: Array, residuals: list[Array]) -> str:
    """The part of the motion in which most is left; empty for channels that do not know torque and speed."""
    s = view.signals
    if view.name != Channel.SET_POINT_TO_LOAD or not isinstance(s, ActuatorSignals):
        return ""
    torque, speed = s.finish(s.torque_nm), s.finish(s.velocity_rad_s)
    sizes: dict[str, list[float]] = {}
    for n in chosen:
        block = board.blocks[n]
        own, square = (torque[block.samples, block.row], speed[block.samples, block.row]), residuals[n] ** 2
        parts = {"motoring": own[0] * own[1] > 0.0, "braking": own[0] * own[1] < 0.0}
        for word, values in zip(("torque", "speed"), np.abs(own), strict=True):
            low, high = np.quantile(values, (1 / 3, 2 / 3))
            parts |= {f"low {word}": values < low, f"high {word}": values > high}
        for word, rows in parts.items():
            sizes.setdefault(word, []).append(float(np.mean(square[rows])) if rows.any() else 0.0)
    return max(sizes, key=lambda word: float(np.mean(sizes[word])))
