"""Whether what the best set of effects leaves is what formulas leave: a posterior predictive check.

Of closed loops, the distance that the corrected model keeps from the robot is compared with what is ordinary. Of the
residuals, a signal's excess is the logarithm of the mean square that it leaves in folds that the fit never saw, over
that of noise and of what formulas leave. What robots without a fault have is known by channel
(:data:`ORDINARY_EXCESS`); the signal that is farthest beyond it decides.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np
from scipy.special import expit

from diagnosis.channels.channel import Channel
from diagnosis.closed_loop.trials import NOMINAL, Bench, Trials
from diagnosis.decision_constants import ODD_EXCESS, ORDINARY_EXCESS, USUAL_LEFT
from diagnosis.selection.evidence import Board
from diagnosis.selection.nuisance_model import size_of_errors
from diagnosis.selection.scoring import Placed, Scored, null_of
from diagnosis.verdict.explain import Explained
from diagnosis.verdict.posterior import is_unknown, ordinary_gap

SMALLEST: Final = 1e-9
EXACT_LAWS: Final = (Channel.SET_POINT_TO_LOAD, Channel.POLICY_REPLAY)


def excess(board: Board, scored: Scored, signals: Collection[int] | None = None) -> dict[Channel, float]:
    """By channel that is checked, the largest excess of its signals.

    Args:
        board: The evidence.
        scored: A set of effects, maybe none, fitted beside the ordinary errors.
        signals: Numbers of the blocks that count; all by default.
    """
    expected = 1.0 + board.tolerance_square + board.relative_square * scored.explained
    over = np.log(np.maximum(scored.held_out, SMALLEST) / expected)
    found: dict[Channel, float] = {}
    for channel, numbers in board.by_channel.items():
        own = [n for n in numbers if signals is None or n in signals]
        if own and channel in ORDINARY_EXCESS:
            found[channel] = float(over[own].max())
    return found


def only_alike(board: Board, scored: Scored) -> dict[str, float]:
    """By effect of a set, the probability that what is there is only like it.

    With it the program or the servo law still leaves more than ordinary in signals where it shows. Forces on the body
    are no proof: there the right formula leaves as much.
    """
    exact = [n for c in EXACT_LAWS for n in board.by_channel.get(c, ())]
    return {t.effect.name: is_odd(excess(board, scored, {*exact} & {*shown_in(board, t)})) for t in scored.terms}


def shown_in(board: Board, term: Placed) -> list[int]:
    """Numbers of the signals in which an effect shows where it stands."""
    columns = board.columns(term.effect, term.shape)
    return [n for n, units in enumerate(columns.units) if np.any(term.place[units] > 0.0)]


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
