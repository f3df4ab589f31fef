"""Which of the effects that residuals show are causes: those that are there, and without which closed loops change.

The best set of effects is compared with itself less each effect, with rivals in each place, and with ordinary errors
alone. A model that loses an effect keeps the ordinary errors that were fitted beside it: refitted, they would stretch
until they stand in for it. Effects that are there and change nothing are *seen*.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.closed_loop.environment import SURROUNDING_EFFECTS
from diagnosis.closed_loop.trials import NOMINAL, Bench, run_trials
from diagnosis.decision_constants import GROUP_ODDS, OPEN_LOOP_MATTERS, USUAL_LEFT
from diagnosis.library.base import LibraryEffect
from diagnosis.selection.nuisance_model import model_of, size_of_errors
from diagnosis.selection.scoring import Placed, Scored, Scorer, null_of, without
from diagnosis.selection.search import price
from diagnosis.verdict.explain import Explained
from diagnosis.verdict.left_over import excess, is_odd, only_alike
from diagnosis.verdict.posterior import Belief, Hypothesis, believe, between_formulas, log_odds, ordinary_gap
from spot_model.io.model_file import RobotModel

ERRORS = "ordinary errors alone"
ALONE = "ordinary errors in the surroundings of the best set"
Tell = Callable[[float], None]


@dataclass(frozen=True)
class Seen:
    """An effect that is there, and that changes nothing here."""

    term: Placed
    scored: Scored
    moved: float | None
    """(D − floor)/floor of closed loops with and without it; None where nothing was simulated."""


@dataclass(frozen=True)
class Causes:
    """What was decided."""

    found: Explained
    """With the causes alone."""
    first: Explained
    """With all effects that residuals show."""
    belief: Belief
    seen: tuple[Seen, ...]
    stated: str
    """Name of the stated model among the trials."""
    hypotheses: Mapping[str, Scored]
    distances: Mapping[str, float]
    """By name of a hypothesis, and of the nominal model; floors. Empty where nothing can be said."""
    moved: Mapping[str, float]
    """By effect of the best set, (D − floor)/floor between runs with it and without it."""
    scatter_nm: float
    """The floor's W1 part, N·m; NaN where nothing was simulated."""
    model_scatter: float
    """What runs of the best set's model scatter by, in the robot's floors; NaN where nothing was simulated."""
    errors: float
    """Size of the robot's ordinary errors, in published standard deviations."""
    odd: float
    """Probability that residuals leave more than ordinary errors do, whatever is said of it."""
    notes: tuple[str, ...]

    @property
    def left(self) -> float | None:
        """Distance of the best set of effects, whether or not all of them matter; floors, None if it was not run."""
        return self.distances.get(" + ".join(sorted(self.belief.best)) or ERRORS)


def candidates_of(found: Explained) -> dict[str, Scored]:
    """Sets of effects to compare, by name."""
    best = found.selection.best
    if best is None:
        return {ERRORS: null_of(found.board)}
    out = {name_of(best): best}
    nothing = best
    for _ in best.terms:
        nothing = without(nothing, 0)
    out[ERRORS] = nothing
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
    return " + ".join(sorted(t.effect.name for t in scored.terms)) or ERRORS


def name_of_best(found: Explained) -> str:
    """Of the set that was found, maybe none."""
    return name_of(found.selection.best) if found.selection.best is not None else ERRORS


@dataclass(frozen=True)
class Tried:
    """Closed loops of all candidates."""

    distances: Mapping[str, float]
    """By name of a candidate, and of the nominal model; floors. Empty where nothing was simulated."""
    moved: Mapping[str, float]
    """By name of an effect of the best set: (D − floor)/floor between runs with and without it, all else alike."""
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

    The best set and ordinary errors alone are in surroundings of their own, the rest in the best set's, so that what is
    compared differs in one effect.
    """
    bench = with_environment(bench, found, nominal)
    best = name_of_best(found)
    like = {name: best for name in candidates if name not in (best, ERRORS)}
    simulated = dict(candidates)
    if len(found.effects) == 1:
        # Without its one effect the best set is ordinary errors alone, but in its own surroundings.
        simulated[ALONE], like[ALONE] = candidates[ERRORS], best
    trials = run_trials(bench, nominal, found.board, simulated, like, rng, tell, only_ticks=True)
    moved = {}
    for effect in found.effects:
        less = ALONE if len(found.effects) == 1 else " + ".join(sorted(set(found.effects) - {effect}))
        if best in trials.runs and less in trials.runs:
            moved[effect] = trials.moved(best, less, bench.policy)
    scatter = trials.scatter_of(best, bench.policy) if best in trials.runs else float("nan")
    return Tried(trials.distances(), moved, trials.notes, trials.scatter_nm(), scatter)


def decide(
    found: Explained,
    nominal: RobotModel,
    bench: Bench | None,
    library: Mapping[str, LibraryEffect],
    rng: np.random.Generator,
    tell: Tell = lambda _: None,
) -> Causes:
    """Compare, and keep what matters.

    Args:
        found: From the residuals.
        nominal: The simulator's model.
        bench: Real logs and how to simulate them; None without a policy: open-loop prediction decides then.
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
    tried = try_out(found, nominal, candidates, bench, rng, tell) if bench is not None else Tried({}, {})
    distances = dict(tried.distances)
    if ERRORS in distances and best in distances:
        # A robot that lies where the plain nominal model lies has no gap either.
        distances[ERRORS] = min(distances[ERRORS], distances[NOMINAL])
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
    """The likeliest set less what is not there, or does not matter."""
    tried, best = compared.tried, found.selection.best or null_of(found.board)
    gains = dict(zip(found.effects, found.selection.gains, strict=True))
    beyond = found.remainder().beyond(USUAL_LEFT)
    errors, odd = size_of_errors(found.board, best.pulls), is_odd(excess(found.board, best))
    ordinary = ordinary_gap(tried.scatter_nm, errors, odd, tried.model_scatter)
    alike = only_alike(found.board, best)
    hypotheses = tuple(compared.hypotheses.values())
    belief = believe(hypotheses, found.effects, gains, found.n_runs, beyond, tried.moved, ordinary, alike)
    kept, seen = best, []
    for term in best.terms:
        if not _is_cause(found, best, term, belief):
            kept = without(kept, kept.terms.index(term))
            if belief.there[term.effect.name] > 0.5:
                seen.append(Seen(term, best, tried.moved.get(term.effect.name)))
    return Causes(
        found.with_effects(kept, library),
        first,
        belief,
        tuple(seen),
        name_of(kept),
        dict(compared.candidates),
        dict(tried.distances),
        dict(tried.moved),
        tried.scatter_nm,
        tried.model_scatter,
        errors,
        odd,
        tried.notes,
    )


def _is_cause(found: Explained, best: Scored, term: Placed, belief: Belief) -> bool:
    """By closed loops; where there are none, by open-loop prediction."""
    there = belief.there[term.effect.name]
    if there <= 0.5:
        return False
    if belief.nearer:
        return belief.effects[term.effect.name] > 0.5
    others = tuple(t for t in best.terms if t is not term)
    less = Scorer(found.board, others).now
    board = found.board
    allowed = board.tolerance_square + board.relative_square * less.explained
    return bool(np.max((less.held_out - best.held_out) / allowed, initial=0.0) > OPEN_LOOP_MATTERS**2)


def with_environment(bench: Bench, found: Explained, nominal: RobotModel) -> Bench:
    """The bench; where the ground, a foot or the estimator was found, all models share the stated one's environment."""
    best = found.selection.best
    if best is None or not any(t.effect.name in SURROUNDING_EFFECTS for t in best.terms):
        return bench
    return replace(bench, shared=model_of(nominal, found.board, best), surroundings={})
