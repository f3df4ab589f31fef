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
from diagnosis.library.base import LibraryEffect
from diagnosis.selection.likeness import likeness
from diagnosis.selection.scoring import Scored, Scorer, null_of, without
from diagnosis.selection.search import price
from diagnosis.verdict.explain import Explained
from diagnosis.verdict.posterior import Belief, Hypothesis, believe, between_formulas, beyond_formulas

CALIBRATED = "calibration alone"


@dataclass(frozen=True)
class Causes:
    """What was decided."""

    found: Explained
    """With the differences alone."""
    first: Explained
    """With all effects that residuals show."""
    belief: Belief
    hypotheses: Mapping[str, Scored]

    @property
    def best(self) -> Scored:
        """The differences, fitted beside the ordinary errors; these alone where there is no difference."""
        return self.found.selection.best or null_of(self.found.board)

    @property
    def stated(self) -> str:
        """Name of the set of the differences."""
        return name_of(self.best)


def decide(found: Explained, library: Mapping[str, LibraryEffect]) -> Causes:
    """Keep what is probably there.

    Args:
        found: From the residuals.
        library: Where rivals come from.
    """
    hypotheses = candidates_of(found)
    believed = [
        Hypothesis(tuple(t.effect.name for t in s.terms), _refitted_nats(found, s)) for s in hypotheses.values()
    ]
    best = found.selection.best or null_of(found.board)
    belief = believe(believed, found.effects, own_nats(found), found.n_runs)
    kept = best
    for term in best.terms:
        if belief.there[term.effect.name] <= NAMED:
            kept = without(kept, kept.terms.index(term))
    return Causes(found.with_effects(kept, library), found, belief, hypotheses)


def own_nats(found: Explained) -> dict[str, float]:
    """By effect of the best set, what it adds to the others beyond what formulas of stronger ones may leave."""
    best = found.selection.best or null_of(found.board)
    own = beyond_formulas(np.array(found.selection.gains), likeness(Scorer(found.board, best.terms)))
    return {name: float(nats) for name, nats in zip(found.effects, own, strict=True)}


def candidates_of(found: Explained) -> dict[str, Scored]:
    """Sets of effects to compare, by name."""
    best = found.selection.best
    if best is None:
        return {CALIBRATED: null_of(found.board)}
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
    """Of a set of effects."""
    return " + ".join(sorted(t.effect.name for t in scored.terms)) or CALIBRATED


def _refitted_nats(found: Explained, scored: Scored) -> float:
    """Evidence of a set of effects beside the ordinary errors that suit it, less the price of its numbers."""
    if not scored.terms:
        return 0.0
    return Scorer(found.board, scored.terms).now.score - price(scored.terms, found.board)
