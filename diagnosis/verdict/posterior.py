"""Probabilities, from residuals and closed loops together: of each difference, and of something the library lacks.

That an effect of the best set is there, has the odds

    log p / (1 − p) = a + b · log(nats) + c · floors,

nats being the evidence that residuals lose without it, and floors by how much closed loops lie farther from the robot
then; no more than the whole set's, asked in the same way. Formulas are never exact, so odds grow with the logarithm of
the evidence; a, b and c are fitted to simulated robots whose faults are known (``benchmarks/calibrate_diagnosis.py``).
No run tells more than log((1 − ε)/ε), ε being the share of odd runs: one short run never proves a difference. Rivals
share an effect's probability by evidence and distance.

Whether an effect matters is no part of this: its consequences are measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, softmax

from diagnosis.decision_constants import (
    FORMULA_ERROR,
    GAP_SLOPE,
    GAP_SPREAD,
    GROUP_ODDS,
    LARGEST_ERRORS,
    LEFT_SHARE,
    ODD_RUN,
    ORDINARY_LEFT_NM,
    RUNS_APART,
    THERE,
    THERE_BY_RESIDUALS,
    UNKNOWN,
    USUAL_ERRORS,
    USUAL_LEFT,
)


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects."""

    effects: tuple[str, ...]
    """Names; empty for the robot's calibration alone."""
    nats: float
    """Evidence of the residuals against none, less the price of its numbers."""
    distance: float | None = None
    """Of its closed loops to the robot's, in floors; None where nothing can be simulated."""


@dataclass(frozen=True)
class Belief:
    """Probabilities of the effects that were found, of their rivals, and of something else."""

    best: tuple[str, ...]
    """Effects of the set that was found."""
    none: float
    """That nothing is there beside the robot's own calibration."""
    unknown: float
    """That something is there that no effect of the library is."""
    there: Mapping[str, float]
    """By effect of the best set: that it, or a rival in its place, is there; each by itself."""
    weights: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    """Of each hypothesis, adding up to 1."""
    nearer: Mapping[str, float] = field(default_factory=dict)
    """By how many floors closed loops come nearer to the robot's with an effect of the best set than without it; empty
    where nothing was simulated."""

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


def believe(
    hypotheses: Sequence[Hypothesis],
    best: tuple[str, ...],
    gains: Mapping[str, float],
    n_runs: int,
    beyond_nats: float,
    ordinary: float,
    alike: Mapping[str, float] | None = None,
) -> Belief:
    """Probabilities of the hypotheses, and of none of them.

    Args:
        hypotheses: All that were tried; the empty set, and the best one with each of its effects left out, among them.
        best: Effects of the one that was found.
        gains: By effect of the best set, nats that the evidence loses without it, refitted.
        n_runs: Logs.
        beyond_nats: What signals still predict of the residuals that the best set leaves, beyond the usual.
        ordinary: Distance in floors that is ordinary for this robot, as :func:`ordinary_gap` has it.
        alike: By effect of the best set, the probability that its own signals leave more than ordinary with it: what is
            there is only like it then.
    """
    by_set = {frozenset(h.effects): h for h in hypotheses}
    nothing, stated = by_set[frozenset()], by_set[frozenset(best)]
    odds = shares([log_odds(h, stated) for h in hypotheses], n_runs)
    weights = {h.effects: float(w) for h, w in zip(hypotheses, odds, strict=True)}
    nearer: dict[str, float] = {}
    at_all, explained = 1.0, 0.0
    if stated.distance is not None and nothing.distance is not None:
        nearer = {n: _distance(by_set, frozenset(best) - {n}) - stated.distance for n in best}
        explained = nothing.distance - stated.distance
        # Effects can make up for each other, and all of them together lead away from the robot.
        at_all = is_there(stated.nats, explained, n_runs) if best else 1.0
    there = {
        n: min(at_all, is_there(gains[n], nearer.get(n), n_runs)) * (1.0 - (alike or {}).get(n, 0.0)) for n in best
    }
    unknown = is_unknown(stated.distance, max(explained, 0.0), beyond_nats, ordinary)
    none = min((1.0 - either_of(there.values())) * (1.0 - unknown), float(expit(most_log_odds(n_runs))))
    return Belief(best, none, unknown, there, weights, nearer)


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


def log_odds(rival: Hypothesis, stated: Hypothesis) -> float:
    """Of a set of effects against the stated one, from residuals and, where they were run, closed loops."""
    farther = (rival.distance or 0.0) - (stated.distance or 0.0)
    return between_formulas(rival.nats - stated.nats, stated.nats) - farther / GAP_SPREAD


def between_formulas(more_nats: float, nats: float) -> float:
    """What the nats count that a rival formula explains more than another, which explains ``nats``.

    The right formula is itself off by :data:`FORMULA_ERROR` of what it explains: so large a difference is one nat.
    """
    return more_nats / (1.0 + FORMULA_ERROR * max(nats, 0.0))


def is_there(nats: float, nearer: float | None, n_runs: int) -> float:
    """Probability that an effect is there beside the others of its set.

    Args:
        nats: What the residuals' evidence loses without it.
        nearer: By how many floors closed loops are nearer with it; None where none were run, or not without it.
        n_runs: Logs.
    """
    size = float(np.log(max(nats, 1e-9)))
    if nearer is None or not np.isfinite(nearer):
        log_odds = float(np.dot(THERE_BY_RESIDUALS, (1.0, size)))
    else:
        log_odds = float(np.dot(THERE, (1.0, size, nearer)))
    return float(expit(min(log_odds, most_log_odds(n_runs))))


def most_log_odds(n_runs: int) -> float:
    """What so many runs can tell at most, for or against."""
    return max(n_runs, 1) * float(np.log((1.0 - ODD_RUN) / ODD_RUN))


def _distance(by_set: Mapping[frozenset[str], Hypothesis], key: frozenset[str]) -> float:
    found = by_set.get(key)
    return float(found.distance) if found is not None and found.distance is not None else float("inf")
