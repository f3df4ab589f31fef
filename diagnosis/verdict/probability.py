"""Probabilities: of each difference, from the residuals, and of something that the library lacks.

That an effect of the best set is there, has the odds

    log p / (1 − p) = a + b · log(nats),

nats being the evidence that residuals lose without it. Formulas are never exact, so odds grow with the logarithm of the
evidence; a and b are fitted to simulated robots whose faults are known (``benchmarks/calibrate_diagnosis.py``). No run
tells more than log((1 − ε)/ε), ε being the share of odd runs: one short run never proves a difference. Rivals share an
effect's probability by their evidence.

Whether an effect matters is no part of this: closed loops measure what it does, and how much they leave tells whether
something unknown is there.

Whether what the best set of effects leaves is what formulas leave: a posterior predictive check.

Of closed loops, the distance that the corrected model keeps from the robot is compared with what is ordinary. Of the
residuals, a signal's excess is the logarithm of the mean square that it leaves in folds that the fit never saw, over
that of noise and of what formulas leave. What robots without a fault have is known by channel
(:data:`ORDINARY_EXCESS`); the signal that is farthest beyond it decides.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, softmax

from diagnosis.channels import Channel
from diagnosis.closed_loop.trials import NOMINAL, Trials
from diagnosis.decision_constants import (
    FORMULA_ERROR,
    GAP_SLOPE,
    GROUP_ODDS,
    LARGEST_ERRORS,
    LEFT_SHARE,
    ODD_EXCESS,
    ODD_RUN,
    ORDINARY_EXCESS,
    ORDINARY_LEFT_NM,
    PRESENCE_LOG_ODDS,
    RUNS_APART,
    UNKNOWN,
    USUAL_ERRORS,
    USUAL_LEFT,
)
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.robot_models import size_of_errors
from diagnosis.selection.scoring import Scored
from diagnosis.verdict.explanation import Explanation


@dataclass(frozen=True)
class Belief:
    """Probabilities of the effects that were found, and of their rivals."""

    best: tuple[str, ...]
    """Effects of the set that was found."""
    there: Mapping[str, float]
    """By effect of the best set: that it, or a rival in its place, is there; each by itself."""
    weights: Mapping[tuple[str, ...], float]
    """Probability of each set of effects, adding up to 1."""

    @staticmethod
    def of(
        nats: Mapping[tuple[str, ...], float], best: tuple[str, ...], gains: Mapping[str, float], n_runs: int
    ) -> Belief:
        """Probabilities of sets of effects.

        Args:
            nats: By set of effects, evidence against none, less the price of its numbers; the empty set, ``best``, and
                that with each of its effects left out, among them.
            best: The set that was found.
            gains: By effect of the best set, what it adds to the others, nats.
            n_runs: Logs.
        """
        stated = nats[best]
        odds = shares([between_formulas(own - stated, stated) for own in nats.values()], n_runs)
        there = {name: is_there(gains[name], n_runs) for name in best}
        return Belief(best, there, dict(zip(nats, odds.tolist(), strict=True)))

    def group(self, effect: str) -> dict[str, float]:
        """Effects that could stand in an effect's place in the best set, with their odds; adds up to 1."""
        others = frozenset(self.best) - {effect}
        found = {
            next(iter(frozenset(h) - others)): w
            for h, w in self.weights.items()
            if len(h) == len(self.best) and others < frozenset(h)
        }
        total = sum(found.values())
        ranked = sorted(found.items(), key=lambda item: -item[1])
        return {name: w / total for name, w in ranked if w >= GROUP_ODDS * ranked[0][1]} if total > 0.0 else {}


def shares(nats: Sequence[float], n_runs: int) -> NDArray[np.float64]:
    """Probabilities of hypotheses that were as likely before runs of which some are odd; shape (n,), adding up to 1.

    Each run by itself gives p; an odd one points to any of the other hypotheses:

        q = (1 − ε) p + ε (1 − p) / (n − 1)

    Args:
        nats: Evidence of all runs together, one a hypothesis.
        n_runs: How many they are.
    """
    runs = max(n_runs, 1)
    p = softmax(np.asarray(nats, dtype=np.float64) / runs)
    return np.asarray(softmax(runs * np.log((1.0 - ODD_RUN) * p + ODD_RUN * (1.0 - p) / max(len(p) - 1, 1))))


def is_none(there: Iterable[float], unknown: float, n_runs: int) -> float:
    """Probability that nothing is there beside the robot's own calibration; one run never proves it."""
    return min((1.0 - either_of(there)) * (1.0 - unknown), float(expit(most_log_odds(n_runs))))


def ordinary_gap(scatter_nm: float, errors: float, odd: float = 0.0, model_scatter: float = 1.0) -> float:
    """Distance in floors that 95 of 100 robots without a fault keep from a model with their ordinary errors.

    Args:
        scatter_nm: The floor's W1 part: between repeats of the robot's own runs, N·m.
        errors: Size of the robot's ordinary errors, in published standard deviations.
        odd: Probability that residuals leave more than ordinary errors do: the errors fitted to them mean little then.
        model_scatter: What the model's own runs scatter by, in floors; NaN if unknown. Runs of two that scatter by 1
            and by m lie √((1 + m²)/2) apart, even where nothing else differs.
    """
    largest = LARGEST_ERRORS + odd * (USUAL_ERRORS - LARGEST_ERRORS)
    return float(np.hypot(runs_apart(model_scatter), ORDINARY_LEFT_NM * min(errors, largest) / max(scatter_nm, 1e-6)))


def runs_apart(model_scatter: float) -> float:
    """Distance in floors that a model without any error keeps whose own runs scatter by so many; NaN counts as 1."""
    return float(RUNS_APART * np.sqrt((1.0 + (model_scatter if np.isfinite(model_scatter) else 1.0) ** 2) / 2.0))


def either_of(probabilities: Iterable[float]) -> float:
    """Probability of one or another of some that are independent."""
    return 1.0 - float(np.prod([1.0 - p for p in probabilities]))


def is_unknown(left: float | None, explained: float, beyond_nats: float, ordinary: float) -> float:
    """Probability of something that no effect of the library is: by the distance that is left, and by the residuals.

    Args:
        left: Distance of the best set's closed loops, in floors; None where nothing was simulated.
        explained: By how much that is less than without any effect; formulas leave a share of it.
        beyond_nats: What signals still predict of the residuals, beyond the usual.
        ordinary: Distance in floors that is ordinary for this robot.
    """
    if left is None:
        return beyond_nats / (beyond_nats + sum(USUAL_LEFT.values()))
    gap = float(np.log(max(left, 1e-3) / (ordinary + LEFT_SHARE * explained)))
    by_residuals = float(expit(np.dot(UNKNOWN, (1.0, gap, np.log1p(beyond_nats)))))
    return either_of((by_residuals, float(expit(GAP_SLOPE * gap))))


def between_formulas(more_nats: float, nats: float) -> float:
    """What the nats count that a rival formula explains more than another, which explains ``nats``.

    The right formula is itself off by :data:`FORMULA_ERROR` of what it explains: so large a difference is one nat.
    """
    return more_nats / (1.0 + FORMULA_ERROR * max(nats, 0.0))


def is_there(nats: float, n_runs: int) -> float:
    """Probability that an effect is there beside the others of its set.

    Args:
        nats: What the residuals' evidence loses without it.
        n_runs: Logs.
    """
    log_odds = float(np.dot(PRESENCE_LOG_ODDS, (1.0, np.log(max(nats, 1e-9)))))
    return float(expit(min(log_odds, most_log_odds(n_runs))))


def beyond_formulas(gains: NDArray[np.float64], alike: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nats that each effect adds beyond what the formulas of stronger effects may leave; shape (T,).

    A formula is off by :data:`FORMULA_ERROR` of what it explains, and an effect that is like it explains that.

    Args:
        gains: What each effect adds to the others, nats, shape (T,).
        alike: By pair, the share of what the first explains that the second could explain, shape (T, T).
    """
    stronger = gains[:, None] > gains[None, :]
    explained = np.sum(np.where(stronger, alike * np.maximum(gains, 0.0)[:, None], 0.0), axis=0)
    return np.asarray(gains / (1.0 + FORMULA_ERROR * explained))


def most_log_odds(n_runs: int) -> float:
    """What so many runs can tell at most, for or against."""
    return max(n_runs, 1) * float(np.log((1.0 - ODD_RUN) / ODD_RUN))


SMALLEST: Final = 1e-9


def excess(board: Evidence, scored: Scored) -> dict[Channel, float]:
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


def unknown_beside(
    first: Explanation, trials: Trials | None, calibrated: str, stated: str, *, is_calibrated: bool = False
) -> float:
    """Probability of something that no effect of the library is.

    Args:
        first: All effects that residuals show.
        trials: Runs of the models; None where nothing was simulated.
        calibrated: Name of the model with the robot's calibration alone.
        stated: Name of the corrected model.
        is_calibrated: Whether the nominal model holds this robot's ordinary errors already, from an earlier diagnosis:
            what formulas leave of them is the usual, however little there is to calibrate.
    """
    beyond = first.remainder.beyond(USUAL_LEFT)
    distances = trials.distances() if trials is not None else {}
    if trials is None or not {calibrated, stated} <= distances.keys():
        return is_unknown(None, 0.0, beyond, 0.0)
    best = first.selection.best
    errors, odd = size_of_errors(first.board, best.pulls), is_odd(excess(first.board, best))
    errors = max(errors, USUAL_ERRORS) if is_calibrated else errors
    ordinary = ordinary_gap(trials.scatter_nm(), errors, odd, trials.scatter_of(stated))
    # A robot that lies where the plain nominal model lies has no gap either.
    explained = min(distances[calibrated], distances[NOMINAL]) - distances[stated]
    return is_unknown(distances[stated], max(explained, 0.0), beyond, ordinary)
