"""Which of the effects that residuals show are differences between the robot and its model.

An effect counts by what it adds to the others, beyond what the formulas of stronger effects like it may leave.
The best set of effects is compared with itself less each effect, with rivals in each place, and with the robot's own
calibration alone. A model that loses an effect keeps the ordinary errors that were fitted beside it: refitted, they
would stretch until they stand in for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from diagnosis.decision_constants import GROUP_ODDS, NAMED
from diagnosis.library import LibraryEffect
from diagnosis.selection.scoring import Scored, Scorer, likeness, without
from diagnosis.selection.search import price
from diagnosis.verdict.explanation import Explanation
from diagnosis.verdict.probability import Belief, between_formulas, beyond_formulas

CALIBRATED = "calibration alone"


@dataclass(frozen=True)
class Causes:
    """What was decided."""

    found: Explanation
    """With the differences alone."""
    belief: Belief
    """Belief in the differences."""
    first: Explanation
    """With all effects that residuals show."""
    at_first: Belief
    """Belief in all effects that residuals show."""
    hypotheses: Mapping[str, Scored]
    """Sets that were compared at first, by name."""

    @property
    def best(self) -> Scored:
        """The differences, fitted beside the ordinary errors; these alone where there is no difference."""
        return self.found.selection.best

    @property
    def stated(self) -> str:
        """Name of the set of the differences."""
        return name_of(self.best)

    @property
    def there(self) -> Mapping[str, float]:
        """By effect that residuals show, that it, or a rival in its place, is there."""
        return {**self.at_first.there, **self.belief.there}


def decide(found: Explanation, library: Mapping[str, LibraryEffect]) -> Causes:
    """Leave out what is probably not there, the weakest first: what it shared with others is theirs then.

    Args:
        found: From the residuals.
        library: Where rivals come from.
    """
    first, hypotheses = found, candidates_of(found)
    belief = at_first = believed(found, hypotheses)
    while belief.there:
        weakest = min(belief.there, key=lambda name: belief.there[name])
        if belief.there[weakest] > NAMED:
            break
        kept = [t for t in found.selection.best.terms if t.effect.name != weakest]
        found = found.with_effects(kept, library)
        belief = believed(found, candidates_of(found))
    return Causes(found, belief, first, at_first, hypotheses)


def believed(found: Explanation, hypotheses: Mapping[str, Scored]) -> Belief:
    """Probabilities of some sets of effects, the best one among them."""
    nats = {tuple(t.effect.name for t in s.terms): _refitted_nats(found, s) for s in hypotheses.values()}
    return Belief.of(nats, found.effects, own_nats(found), found.n_runs)


def own_nats(found: Explanation) -> dict[str, float]:
    """By effect of the best set, what it adds to the others beyond what formulas of stronger ones may leave."""
    own = beyond_formulas(np.array(found.selection.gains), likeness(Scorer(found.board, found.selection.best.terms)))
    return {name: float(nats) for name, nats in zip(found.effects, own, strict=True)}


def candidates_of(found: Explanation) -> dict[str, Scored]:
    """Sets of effects to compare, by name."""
    best = found.selection.best
    out = {name_of(best): best}
    nothing = best
    for _ in best.terms:
        nothing = without(nothing, 0)
    out[CALIBRATED] = nothing
    for i, rivals in enumerate(found.selection.rivals):
        less = without(best, i)
        out.setdefault(name_of(less), less)
        top = rivals[0].value if rivals else 0.0
        for rival in rivals[1:]:
            if between_formulas(rival.value - top, top) > np.log(GROUP_ODDS):
                out.setdefault(name_of(rival.scored), rival.scored)
    return out


def name_of(scored: Scored) -> str:
    """Name of a set of effects."""
    return " + ".join(sorted(t.effect.name for t in scored.terms)) or CALIBRATED


def _refitted_nats(found: Explanation, scored: Scored) -> float:
    """Evidence of a set of effects beside the ordinary errors that suit it, less the price of its numbers."""
    if not scored.terms:
        return 0.0
    return Scorer(found.board, scored.terms).now.score - price(scored.terms, found.board)
