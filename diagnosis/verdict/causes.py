"""Which of the effects that residuals show are differences between the robot and its model.

The best set of effects is compared with itself less each effect, with rivals in each place, and with the robot's own
calibration alone. A model that loses an effect keeps the ordinary errors that were fitted beside it: refitted, they
would stretch until they stand in for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.closed_loop.environment import SURROUNDING_EFFECTS
from diagnosis.closed_loop.trials import NOMINAL, Bench, run_trials
from diagnosis.decision_constants import GROUP_ODDS, NAMED, USUAL_LEFT
from diagnosis.library.base import LibraryEffect
from diagnosis.selection.nuisance_model import model_of, size_of_errors
from diagnosis.selection.scoring import Scored, Scorer, null_of, without
from diagnosis.selection.search import price
from diagnosis.verdict.explain import Explained
from diagnosis.verdict.left_over import excess, is_odd, only_alike
from diagnosis.verdict.posterior import Belief, Hypothesis, believe, between_formulas, log_odds, ordinary_gap
from spot_model.io.model_file import RobotModel

CALIBRATED = "calibration alone"
Tell = Callable[[float], None]


@dataclass(frozen=True)
class Causes:
    """What was decided."""

    found: Explained
    """With the differences alone."""
    first: Explained
    """With all effects that residuals show."""
    belief: Belief
    stated: str
    """Name of the model with the differences among the trials."""
    hypotheses: Mapping[str, Scored]
    distances: Mapping[str, float]
    """By name of a hypothesis, and of the nominal model; floors. Empty where nothing can be said."""
    ordinary: float
    """Distance in floors that is ordinary for this robot."""
    notes: tuple[str, ...]


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


def _refitted_nats(found: Explained, scored: Scored) -> float:
    """Evidence of a set of effects beside the ordinary errors that suit it, less the price of its numbers."""
    if not scored.terms:
        return 0.0
    return Scorer(found.board, scored.terms).now.score - price(scored.terms, found.board)


def name_of(scored: Scored) -> str:
    """Of a set of effects."""
    return " + ".join(sorted(t.effect.name for t in scored.terms)) or CALIBRATED


def name_of_best(found: Explained) -> str:
    """Of the set that was found, maybe none."""
    return name_of(found.selection.best) if found.selection.best is not None else CALIBRATED


@dataclass(frozen=True)
class Tried:
    """Closed loops of all candidates."""

    distances: Mapping[str, float]
    """By name of a candidate, and of the nominal model; floors. Empty where nothing was simulated."""
    notes: tuple[str, ...] = ()
    scatter_nm: float = float("nan")
    """The floor's W1 part, N·m."""
    model_scatter: float = float("nan")
    """What runs of the best set's model scatter by, in the robot's floors."""


def try_out(
    found: Explained,
    nominal: RobotModel,
    candidates: Mapping[str, Scored],
    bench: Bench,
    rng: np.random.Generator,
    tell: Tell = lambda _: None,
) -> Tried:
    """Simulate the candidates.

    The best set and the calibration alone are in surroundings of their own, the rest in the best set's, so that what is
    compared differs in one effect.
    """
    bench = with_environment(bench, found, nominal)
    best = name_of_best(found)
    like = {name: best for name in candidates if name not in (best, CALIBRATED)}
    trials = run_trials(bench, nominal, found.board, candidates, like, rng, tell, only_ticks=True)
    scatter = trials.scatter_of(best, bench.policy) if best in trials.runs else float("nan")
    return Tried(trials.distances(), trials.notes, trials.scatter_nm(), scatter)


def decide(
    found: Explained,
    nominal: RobotModel,
    bench: Bench | None,
    library: Mapping[str, LibraryEffect],
    rng: np.random.Generator,
    tell: Tell = lambda _: None,
) -> Causes:
    """Compare, and keep what is there.

    Args:
        found: From the residuals.
        nominal: The simulator's model.
        bench: Real logs and how to simulate them; None without a policy: residuals decide alone then.
        library: Where rivals come from.
        rng: Draws seeds.
        tell: Called with the share that is done.
    """
    first = found
    compared = _compare(found, nominal, bench, rng, lambda share: tell(0.6 * share))
    rival = compared.likeliest()
    if rival != name_of_best(found):
        # Closed loops prefer what residuals put second. Its ordinary errors are others: so are those of the sets less
        # an effect with which it is compared.
        found = found.with_effects(compared.candidates[rival], library)
        compared = _compare(found, nominal, bench, rng, lambda share: tell(0.6 + 0.4 * share))
    return _kept(found, first, compared, library)


@dataclass(frozen=True)
class _Compared:
    """Candidates, and what residuals and closed loops say of each."""

    best: str
    candidates: Mapping[str, Scored]
    hypotheses: Mapping[str, Hypothesis]
    tried: Tried

    def likeliest(self) -> str:
        """Of the sets with as many effects as the best."""
        best = self.hypotheses[self.best]
        rivals = {n: h for n, h in self.hypotheses.items() if len(h.effects) == len(best.effects)}
        return max(rivals, key=lambda name: log_odds(rivals[name], best))


def _compare(
    found: Explained, nominal: RobotModel, bench: Bench | None, rng: np.random.Generator, tell: Tell
) -> _Compared:
    candidates, best = candidates_of(found), name_of_best(found)
    tried = try_out(found, nominal, candidates, bench, rng, tell) if bench is not None else Tried({})
    distances = dict(tried.distances)
    if CALIBRATED in distances and best in distances:
        # A robot that lies where the plain nominal model lies has no gap either.
        distances[CALIBRATED] = min(distances[CALIBRATED], distances[NOMINAL])
    else:
        # What cannot be simulated is judged by the residuals alone.
        distances = {}
    hypotheses = {
        name: Hypothesis(tuple(t.effect.name for t in s.terms), _refitted_nats(found, s), distances.get(name))
        for name, s in candidates.items()
        if not distances or name in distances
    }
    return _Compared(best, candidates, hypotheses, tried)


def _kept(found: Explained, first: Explained, compared: _Compared, library: Mapping[str, LibraryEffect]) -> Causes:
    """The likeliest set less what is probably not there."""
    tried, best = compared.tried, found.selection.best or null_of(found.board)
    gains = dict(zip(found.effects, found.selection.gains, strict=True))
    beyond = found.remainder().beyond(USUAL_LEFT)
    errors, odd = size_of_errors(found.board, best.pulls), is_odd(excess(found.board, best))
    ordinary = ordinary_gap(tried.scatter_nm, errors, odd, tried.model_scatter)
    alike = only_alike(found.board, best)
    belief = believe(tuple(compared.hypotheses.values()), found.effects, gains, found.n_runs, beyond, ordinary, alike)
    kept = best
    for term in best.terms:
        if belief.there[term.effect.name] <= NAMED:
            kept = without(kept, kept.terms.index(term))
    return Causes(
        found.with_effects(kept, library),
        first,
        belief,
        name_of(kept),
        dict(compared.candidates),
        dict(tried.distances),
        ordinary,
        tried.notes,
    )


def with_environment(bench: Bench, found: Explained, nominal: RobotModel) -> Bench:
    """The bench; where the ground, a foot or the estimator was found, all models share the stated one's environment."""
    best = found.selection.best
    if best is None or not any(t.effect.name in SURROUNDING_EFFECTS for t in best.terms):
        return bench
    return replace(bench, shared=model_of(nominal, found.board, best), surroundings={})
