"""Whether what the best set of effects leaves is what formulas leave: a posterior predictive check.

Of closed loops, the distance that the corrected model keeps from the robot is compared with what is ordinary. Of the
residuals, a signal's excess is the logarithm of the mean square that it leaves in folds that the fit never saw, over
that of noise and of what formulas leave. What robots without a fault have is known by channel
(:data:`ORDINARY_EXCESS`); the signal that is farthest beyond it decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.special import expit

from diagnosis.channels.channel import Channel
from diagnosis.closed_loop.trials import NOMINAL, Bench, Trials
from diagnosis.decision_constants import ODD_EXCESS, ORDINARY_EXCESS, USUAL_LEFT
from diagnosis.selection.evidence import Board
from diagnosis.selection.nuisance_model import size_of_errors
from diagnosis.selection.scoring import Scored, null_of
from diagnosis.verdict.explain import Explained
from diagnosis.verdict.posterior import is_unknown, ordinary_gap

SMALLEST: Final = 1e-9


def excess(board: Board, scored: Scored) -> dict[Channel, float]:
    """By channel that is checked, the largest excess of its signals.

    Args:
        board: The evidence.
        scored: A set of effects, maybe none, fitted beside the ordinary errors.
    """
    expected = 1.0 + board.tolerance_square + board.relative_square * scored.explained
    over = np.log(np.maximum(scored.held_out, SMALLEST) / expected)
    return {c: float(over[n].max()) for c, n in board.by_channel.items() if c in ORDINARY_EXCESS}


def is_odd(found: Mapping[Channel, float]) -> float:
    """Probability that some signal leaves more than ordinary errors do; 0 without any signal."""
    even, slope = ODD_EXCESS
    off = [(e - ORDINARY_EXCESS[c][0]) / ORDINARY_EXCESS[c][1] for c, e in found.items()]
    return float(expit(slope * (max(off) - even))) if off else 0.0


def unknown_beside(first: Explained, bench: Bench | None, trials: Trials | None, calibrated: str, stated: str) -> float:
    """Probability of something that no effect of the library is.

    Args:
        first: All effects that residuals show.
        bench: What the models went through; None without a policy.
        trials: Their runs.
        calibrated: Name of the model with the robot's calibration alone.
        stated: Name of the corrected model.
    """
    beyond = first.remainder().beyond(USUAL_LEFT)
    distances = trials.distances() if trials is not None else {}
    if bench is None or trials is None or not {calibrated, stated} <= distances.keys():
        return is_unknown(None, 0.0, beyond, 0.0)
    best = first.selection.best or null_of(first.board)
    errors, odd = size_of_errors(first.board, best.pulls), is_odd(excess(first.board, best))
    ordinary = ordinary_gap(trials.scatter_nm(), errors, odd, trials.scatter_of(stated, bench.policy))
    # A robot that lies where the plain nominal model lies has no gap either.
    explained = min(distances[calibrated], distances[NOMINAL]) - distances[stated]
    return is_unknown(distances[stated], max(explained, 0.0), beyond, ordinary)
