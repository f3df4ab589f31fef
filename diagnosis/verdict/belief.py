"""Which numbers are out of the ordinary: a probability for each effect of the best set, and the effects in its place.

An effect of the best set adds some nats of marginal likelihood to the others, in which all its numbers lie within their
ordinary errors. What the same effect adds on robots without a fault (:mod:`diagnosis.selection.faultless`) is taken off
already, so that odds are even at 0. Where much is left of the channels in which it shows, something unknown may be in
its place. No run tells more than log((1 − ε)/ε), ε being the share of odd runs: one short run never proves a
difference.

Where no log has loads, an effect of the drive is seen relative to what it moves (:func:`lacks_loads`): what the motion
adds speaks for it and for what is moved alike, so that its odds are even at most. Only what other channels add counts.

Whether an effect matters is no part of this: closed loops measure what it does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import expit

from diagnosis.channels import Array
from diagnosis.decision_constants import FORMULA_ERROR, GROUP_ODDS, NAMED, ODD_RUN
from diagnosis.library import MOTION, LibraryEffect, lacks_loads
from diagnosis.selection.faultless import FAULTLESS
from diagnosis.selection.scoring import Placed, Scored, Scorer, likeness, null_of
from diagnosis.verdict.explanation import Explanation
from diagnosis.verdict.left_over import left_over, nats_left, probability

CALIBRATED: Final = "calibration alone"
LEAST: Final = 1e-3
"""Nothing that was tried counts as less likely."""
SHOWS: Final = 1.0
"""Nats that an effect adds to a channel at least, to show there."""


@dataclass(frozen=True)
class Belief:
    """What was decided."""

    found: Explanation
    """With the differences alone: effects that are at least as probably out of the ordinary as not."""
    there: Mapping[str, float]
    """By effect that was shown, also those that are no difference: that it, or a rival in its place, is there."""
    groups: Mapping[str, Mapping[str, float]]
    """By difference: effects that could stand in its place, with their shares, the likeliest first, adding up to 1."""
    sets: Mapping[str, tuple[Scored, float]]
    """Sets of effects that were compared, by name, with weights that add up to 1."""

    @property
    def best(self) -> Scored:
        """The differences, fitted beside the ordinary errors; these alone where there is no difference."""
        return self.found.selection.best

    @property
    def stated(self) -> str:
        """Name of the set of the differences."""
        return name_of_model(self.best)


def decide(found: Explanation, library: Mapping[str, LibraryEffect]) -> Belief:
    """Leave out what is probably not there, the weakest first: what it shared with others is theirs then.

    Args:
        found: From the residuals.
        library: Where rivals come from.
    """
    there: dict[str, float] = {}
    while found.effects:
        own = probabilities(found)
        there |= own
        weakest = min(own, key=lambda name: own[name])
        if own[weakest] >= NAMED:
            break
        kept = [t for t in found.selection.best.terms if t.effect.name != weakest]
        found = found.with_effects(kept, library)
    groups = {name: group_of(found, name) for name in found.effects}
    return Belief(found, there, groups, weighted_sets(found, there, groups))


def probabilities(found: Explanation) -> dict[str, float]:
    """By effect of the best set, that it, or a rival in its place, is there beside the others."""
    scorer = Scorer(found.board, found.selection.best.terms)
    gains = np.array([found.selection.gains[name] for name in found.effects])
    prices = np.array([FAULTLESS.price(name) for name in found.effects])
    alike = np.maximum(likeness(scorer, found.effects), confused(found.selection.best.terms, found.effects))
    own = beyond_formulas(gains + prices, alike) - prices
    most = most_log_odds(found.n_runs)
    there = expit(np.minimum(own, most)) * (1.0 - unknown_instead(found, gains + prices))
    there = np.minimum(there, expit([most_of_motion(found, name) for name in found.effects]))
    return dict(zip(found.effects, map(float, there), strict=True))


def most_of_motion(found: Explanation, name: str) -> float:
    """What channels other than those of the motion say for an effect of a drive without loads; of others no bound."""
    effect = next(t.effect for t in found.selection.best.terms if t.effect.name == name)
    if not lacks_loads(effect, found.board.views):
        return float(np.inf)
    elsewhere = sum(nats for channel, nats in found.selection.channels[name].items() if channel not in MOTION)
    return max(elsewhere - FAULTLESS.price(name), 0.0)


def unknown_instead(found: Explanation, gains: Array) -> Array:
    """Probability that something unknown is there in each effect's place; shape (T,).

    It would explain what the effect explains and the rest of the same channels: the effect answers for its share.

    Args:
        found: The best set and what is left of the channels.
        gains: What each effect adds to the others, nats before any price, shape (T,).
    """
    board, best = found.board, found.selection.best
    left = nats_left(board, best)
    rest = [sum(left[c] for c, own in found.selection.channels[n].items() if own >= SHOWS) for n in found.effects]
    rest_nats = np.array(rest, dtype=np.float64)
    return np.asarray(probability(left_over(board, best)) * rest_nats / np.maximum(rest_nats + gains, 1e-9))


def confused(terms: Sequence[Placed], names: Sequence[str]) -> Array:
    """1 for pairs of effects of which the library says that one can look like the other; shape (T, T)."""
    looks_like = {t.effect.name: set(t.effect.confused_with) for t in terms}
    return np.array([[float(a in looks_like[b] or b in looks_like[a]) for b in names] for a in names])


def beyond_formulas(gains: Array, alike: Array) -> Array:
    """Nats that each effect adds beyond what the formulas of stronger effects may leave; shape (T,).

    A formula is off by :data:`FORMULA_ERROR` of what it explains, and an effect that is like it explains that.

    Args:
        gains: What each effect adds to the others, nats before any price, shape (T,).
        alike: By pair, the share of what the first explains that the second could explain, shape (T, T).
    """
    stronger = gains[:, None] > gains[None, :]
    explained = np.sum(np.where(stronger, alike * np.maximum(gains, 0.0)[:, None], 0.0), axis=0)
    return np.asarray(gains / (1.0 + FORMULA_ERROR * explained))


def most_log_odds(n_runs: int) -> float:
    """What so many runs can tell at most, for or against."""
    return max(n_runs, 1) * float(np.log((1.0 - ODD_RUN) / ODD_RUN))


def group_of(found: Explanation, own: str) -> dict[str, float]:
    """Effects that could stand in the place of one of the best set, with their shares.

    The right formula is itself off by :data:`FORMULA_ERROR` of what it explains: a rival that explains so much less is
    as likely.
    """
    nats = {s.terms[-1].effect.name: s.value for s in found.selection.rivals[own]}
    most = found.selection.gains[own]
    scale = 1.0 + FORMULA_ERROR * max(most, 0.0)
    best = nats.get(own, max(nats.values(), default=0.0))
    odds = {name: float(np.exp(min((value - best) / scale, 0.0))) for name, value in nats.items()}
    odds[own] = 1.0
    near = {name: w for name, w in sorted(odds.items(), key=lambda item: -item[1]) if w >= GROUP_ODDS}
    total = sum(near.values())
    ranked = [own, *(name for name in near if name != own)]
    return {name: near[name] / total for name in ranked}


def weighted_sets(
    found: Explanation, there: Mapping[str, float], groups: Mapping[str, Mapping[str, float]]
) -> dict[str, tuple[Scored, float]]:
    """The best set, the same with a rival in one place, the same without one effect, and none of them.

    Each effect is there or not by itself, itself or one of its rivals.
    """
    best = found.selection.best
    odds = {name_of_model(best): (best, float(np.prod([there[n] * groups[n][n] for n in found.effects])))}
    for name in found.effects:
        rest = float(np.prod([there[n] * groups[n][n] for n in found.effects if n != name]))
        others = [t for t in best.terms if t.effect.name != name]
        less = Scorer(found.board, others).now if others else null_of(found.board)
        odds.setdefault(name_of_model(less), (less, rest * max(1.0 - there[name], LEAST)))
        for rival in found.selection.rivals[name]:
            share = groups[name].get(rival.terms[-1].effect.name, 0.0)
            odds.setdefault(name_of_model(rival), (rival, rest * there[name] * share))
    total = sum(w for _, w in odds.values())
    return {name: (scored, w / total) for name, (scored, w) in odds.items() if w > 0.0}


def name_of_model(scored: Scored) -> str:
    """Name of a set of effects."""
    return " + ".join(sorted({t.effect.name for t in scored.terms})) or CALIBRATED


def is_none(there: Iterable[float], unknown: float, n_runs: int) -> float:
    """Probability that nothing is out of the ordinary; one run never proves it."""
    either = 1.0 - float(np.prod([1.0 - p for p in there]))
    return min((1.0 - either) * (1.0 - unknown), float(expit(most_log_odds(n_runs))))
