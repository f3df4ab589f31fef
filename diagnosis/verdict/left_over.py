"""Whether what the best set of effects leaves of the residuals is what formulas leave: a posterior predictive check.

A signal's excess is the logarithm of the mean square that it leaves in folds that the fit never saw, over that of noise
and of what formulas leave. What robots without a fault have is known by channel (:data:`ORDINARY_EXCESS`); the signal
that is farthest beyond it decides.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import expit

from diagnosis.channels.channel import Channel
from diagnosis.decision_constants import ODD_EXCESS, ORDINARY_EXCESS
from diagnosis.selection.evidence import Board
from diagnosis.selection.scoring import Scored

SMALLEST = 1e-9


def excess(board: Board, scored: Scored) -> dict[Channel, float]:
    """By channel that is checked, the largest excess of its signals.

    Args:
        board: The evidence.
        scored: A set of effects, maybe none, fitted beside the ordinary errors.
    """
    expected = 1.0 + board.tolerance_square + board.relative_square * scored.explained
    over = np.log(np.maximum(scored.held_out, SMALLEST) / expected)
    return {c: float(over[numbers].max()) for c, numbers in board.by_channel.items() if c in ORDINARY_EXCESS}


def is_odd(found: Mapping[Channel, float]) -> float:
    """Probability that some signal leaves more than ordinary errors do; 0 without any signal."""
    even, slope = ODD_EXCESS
    off = [(e - ORDINARY_EXCESS[c][0]) / ORDINARY_EXCESS[c][1] for c, e in found.items()]
    return float(expit(slope * (max(off) - even))) if off else 0.0
