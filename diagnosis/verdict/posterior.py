"""Probabilities: of no gap, of each effect, of something else; from residuals and closed loops together.

Hypotheses are sets of effects, the empty one among them. A hypothesis H has its residual evidence E(H) in nats, with
the price of its effects paid, and the distance d(H) of its closed loops to the robot's in floors. Its weight is

    log w(H) = −N · cap((L(best) − L(H)) / N),   L(H) = E(H) − d(H) / σ

over N runs, with cap(x) = log((1 − ε) eˣ + ε) − log((1 − ε) + ε eˣ): a run is odd with probability ε, and then says
nothing, so that no run tells more than log((1 − ε)/ε). One short run therefore never proves a cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit, ndtr

from diagnosis.decision_constants import (
    BEYOND_DOUBT_NATS,
    GAP_SPREAD,
    GROUP_ODDS,
    MATTERS,
    MATTERS_SHARE,
    ODD_RUN,
    ORDINARY_GAP,
)

NONE = ()


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects."""

    effects: tuple[str, ...]
    """Names; empty for ordinary errors alone."""
    nats: float
    """Evidence of the residuals against none."""
    distance: float | None = None
    """Of its closed loops to the robot's, in floors; None where nothing can be simulated, or without repeats."""


@dataclass(frozen=True)
class Belief:
    """What is thought of all hypotheses together."""

    none: float
    """That the robot lies where the nominal model with ordinary errors lies."""
    unknown: float
    """That something matters that no effect of the library is."""
    effects: Mapping[str, float]
    """That an effect is there and matters; each by itself."""
    weights: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    """Of each hypothesis, adding up to 1."""
    nearer: Mapping[str, float] = field(default_factory=dict)
    """By how many floors closed loops come nearer with an effect of the best set than without it."""

    def group(self, best: Sequence[str], effect: str) -> dict[str, float]:
        """Effects that could stand in an effect's place in the best set, with their odds; adds up to 1."""
        others = frozenset(best) - {effect}
        found = {
            next(iter(frozenset(h) - others)): w
            for h, w in self.weights.items()
            if len(h) == len(best) and others < frozenset(h)
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


def believe(hypotheses: Sequence[Hypothesis], best: tuple[str, ...], n_runs: int, left: float) -> Belief:
    """Probabilities of the hypotheses, and of none of them.

    Args:
        hypotheses: All that were tried; the empty set, and the best one with each of its effects left out, among them.
        best: Effects of the one that is stated.
        n_runs: Logs.
        left: Odds, from the residuals alone, that something no effect explains is left; counts without closed loops.
    """
    by_set = {frozenset(h.effects): h for h in hypotheses}
    nothing = by_set[frozenset()]
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
        return Belief(none, unknown, {n: p * (1.0 - unknown) for n, p in there.items()}, weights)
    stated = by_set[frozenset(best)]
    nearer = {n: _distance(by_set, frozenset(best) - {n}) - float(stated.distance or 0.0) for n in best}
    gap = float(expit(2.0 * (nothing.distance - ORDINARY_GAP) / GAP_SPREAD))
    above = max(nothing.distance - 1.0, 1e-6)
    least = max(MATTERS, MATTERS_SHARE * above)
    moves = {n: float(ndtr((nearer[n] - least) / (np.sqrt(2.0) * GAP_SPREAD))) if n in nearer else 1.0 for n in names}
    # Within ordinary distances an effect needs evidence that ordinary errors cannot stand in for.
    clear = {n: max(gap, _beyond_doubt(by_set, frozenset(best), n, n_runs)) for n in names}
    effects = {n: clear[n] * there[n] * moves[n] for n in names}
    far = max(float(stated.distance or 0.0) - ORDINARY_GAP, 0.0)
    share = min(1.0, 2.0 * far / max(nothing.distance - ORDINARY_GAP, GAP_SPREAD))
    none = (1.0 - gap) * (1.0 - max((effects[n] for n in best), default=0.0))
    return Belief(none, gap * share, effects, weights, nearer)


def _beyond_doubt(by_set: Mapping[frozenset[str], Hypothesis], best: frozenset[str], effect: str, n_runs: int) -> float:
    """Probability, from residuals alone, that an effect of the best set is there beside the others."""
    less = by_set.get(best - {effect})
    if effect not in best or less is None:
        return 0.0
    return float(expit((capped(by_set[best].nats - less.nats, n_runs) - BEYOND_DOUBT_NATS) / 2.0))


def _distance(by_set: Mapping[frozenset[str], Hypothesis], key: frozenset[str]) -> float:
    found = by_set.get(key)
    return float(found.distance) if found is not None and found.distance is not None else float("inf")
