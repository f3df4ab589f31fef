"""Probabilities: of no gap, of each effect, of something else; from residuals and closed loops together.

Hypotheses are sets of effects, the empty one among them. A hypothesis H has its residual evidence E(H) in nats, with
the price of its effects paid, and the distance d(H) of its closed loops to the robot's in floors. Its weight is

    log w(H) = −N · cap((L(best) − L(H)) / N),   L(H) = E(H) − d(H) / σ

over N runs, with cap(x) = log((1 − ε) eˣ + ε) − log((1 − ε) + ε eˣ): a run is odd with probability ε, and then says
nothing, so that no run tells more than log((1 − ε)/ε). One short run therefore never proves a cause.

An effect that is there is a cause if it matters: runs of the best model with it and without it, all else alike, lie
apart by more than a floor beyond their own scatter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit, ndtr

from diagnosis.decision_constants import GAP_SPREAD, GROUP_ODDS, LEAST_MOVED, MOVED_SPREAD, ODD_RUN, ORDINARY_GAP

NONE = ()


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects."""

    effects: tuple[str, ...]
    """Names; empty for ordinary errors alone."""
    nats: float
    """Evidence of the residuals against none."""
    distance: float | None = None
    """Of its closed loops to the robot's, in floors; None where nothing can be simulated."""


@dataclass(frozen=True)
class Belief:
    """What is thought of all hypotheses together."""

    best: tuple[str, ...]
    """Effects of the set that was found, whether or not they matter."""
    none: float
    """That the robot lies where the nominal model with ordinary errors lies."""
    unknown: float
    """That something matters that no effect of the library is."""
    there: Mapping[str, float]
    """That an effect is there; each by itself."""
    effects: Mapping[str, float]
    """That it is there and matters. Without closed loops the same as ``there``."""
    weights: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    """Of each hypothesis, adding up to 1."""
    nearer: Mapping[str, float] = field(default_factory=dict)
    """By how many floors closed loops come nearer to the robot's with an effect of the best set than without it."""

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


def capped(nats: float, n_runs: int) -> float:
    """Evidence of runs of which some are odd; nats, with the sign of what goes in."""
    x = nats / max(n_runs, 1)
    one = np.logaddexp(np.log(1.0 - ODD_RUN) + x, np.log(ODD_RUN))
    other = np.logaddexp(np.log(1.0 - ODD_RUN), np.log(ODD_RUN) + x)
    return float(max(n_runs, 1) * (one - other))


def believe(
    hypotheses: Sequence[Hypothesis], best: tuple[str, ...], n_runs: int, left: float, moved: Mapping[str, float]
) -> Belief:
    """Probabilities of the hypotheses, and of none of them.

    Args:
        hypotheses: All that were tried; the empty set, and the best one with each of its effects left out, among them.
        best: Effects of the one that was found.
        n_runs: Logs.
        left: Odds, from the residuals alone, that something no effect explains is left; counts without closed loops.
        moved: By effect of the best set, (D − floor)/floor between runs with it and without it; others count as what
            they stand in for.
    """
    by_set = {frozenset(h.effects): h for h in hypotheses}
    nothing, stated = by_set[frozenset()], by_set[frozenset(best)]
    is_simulated = all(h.distance is not None for h in hypotheses)
    logs = np.array([h.nats - (h.distance or 0.0) / GAP_SPREAD if is_simulated else h.nats for h in hypotheses])
    shares = np.exp([-capped(float(logs.max() - x), n_runs) for x in logs])
    shares /= shares.sum()
    weights = {h.effects: float(w) for h, w in zip(hypotheses, shares, strict=True)}
    names = dict.fromkeys(name for h in hypotheses for name in h.effects)
    there = {name: sum(w for h, w in weights.items() if name in h) for name in names}
    if not is_simulated or nothing.distance is None:
        unknown = left / (1.0 + left)
        none = weights[nothing.effects] * (1.0 - unknown)
        return Belief(best, none, unknown, there, {n: p * (1.0 - unknown) for n, p in there.items()}, weights)
    nearer = {n: _distance(by_set, frozenset(best) - {n}) - float(stated.distance or 0.0) for n in best}
    effects = {n: there[n] * matters(moved.get(n, max(moved.values(), default=0.0))) for n in names}
    # What is left of the gap counts, and only where there is one.
    gap = float(expit(2.0 * (nothing.distance - ORDINARY_GAP) / GAP_SPREAD))
    far = max(float(stated.distance or 0.0) - ORDINARY_GAP, 0.0)
    share = min(1.0, 2.0 * far / max(nothing.distance - ORDINARY_GAP, GAP_SPREAD))
    none = (1.0 - gap) * (1.0 - max((effects[n] for n in best), default=0.0))
    return Belief(best, none, gap * share, there, effects, weights, nearer)


def matters(moved: float) -> float:
    """Probability that runs of the robot with and without an effect lie apart by more than :data:`LEAST_MOVED`.

    Args:
        moved: By how much runs of the model do; NaN where they could not be compared, as if a robot falls.
    """
    return float(ndtr(np.log((1.0 + max(moved, -0.9)) / (1.0 + LEAST_MOVED)) / MOVED_SPREAD)) if moved == moved else 1.0


def _distance(by_set: Mapping[frozenset[str], Hypothesis], key: frozenset[str]) -> float:
    found = by_set.get(key)
    return float(found.distance) if found is not None and found.distance is not None else float("inf")
