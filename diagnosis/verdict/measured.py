"""What each difference does, and the robot's calibration: models with it and without it, all else alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from diagnosis.closed_loop.consequences import consequences, remainder
from diagnosis.closed_loop.environment import SURROUNDING_EFFECTS
from diagnosis.closed_loop.trials import NOMINAL, Bench, Trials
from diagnosis.document import Consequences, GapLeft
from diagnosis.selection.calibrated import calibrated
from diagnosis.selection.evidence import Board
from diagnosis.selection.fitted import without_effect
from diagnosis.selection.nuisance_model import model_of
from diagnosis.selection.scoring import Scored, Scorer, null_of
from diagnosis.verdict.causes import CALIBRATED
from diagnosis.verdict.open_loop import gap_changes
from spot_model.io.model_file import RobotModel


@dataclass(frozen=True)
class Measured:
    """Consequences of all that was found, and what is left of the gaps."""

    whole: Consequences
    """Of the corrected model against the nominal one."""
    calibration: Consequences | None
    """Of the robot's own numbers, without any difference; None where that model could not be simulated."""
    each: Mapping[str, Consequences] = field(default_factory=dict)
    """By difference, of the corrected model against the same without it."""
    left: tuple[GapLeft, ...] = ()


def compared_models(board: Board, best: Scored, stated: str) -> tuple[dict[str, Scored], dict[str, str]]:
    """The corrected model, the same without each difference, and without all of them.

    Args:
        board: The evidence.
        best: Differences with the ordinary errors that were fitted beside them.
        stated: Name of the corrected model.

    Returns:
        Models by name; and by name of all but the corrected one the name of the model whose surroundings it shares.
    """
    models = {stated: best}
    names = [term.effect.name for term in best.terms]
    nothing = best
    for name in names:
        nothing = without_effect(board, nothing, name)
    models[CALIBRATED] = nothing
    if len(names) > 1:
        models |= {_less(name): without_effect(board, best, name) for name in names}
    return models, {name: stated for name in models if name != stated}


def with_environment(bench: Bench, board: Board, best: Scored, nominal: RobotModel) -> Bench:
    """The bench; where the ground, a foot or the estimator was found, all models share the corrected one's."""
    if not any(t.effect.name in SURROUNDING_EFFECTS for t in best.terms):
        return bench
    return replace(bench, shared=model_of(nominal, board, best))


def measured_by_simulation(
    bench: Bench, trials: Trials, best: Scored, stated: str, rng: np.random.Generator
) -> Measured | None:
    """In closed loop; None where the corrected model could not be simulated."""
    if stated not in trials.runs or not trials.compared:
        return None
    each = {}
    for term in best.terms:
        less = _less(term.effect.name) if len(best.terms) > 1 else CALIBRATED
        if less in trials.runs:
            each[term.effect.name] = consequences(bench, trials, less, stated, rng)
    return Measured(
        consequences(bench, trials, NOMINAL, stated, rng),
        consequences(bench, trials, NOMINAL, CALIBRATED, rng) if CALIBRATED in trials.runs else None,
        each,
        remainder(bench, trials, stated),
    )


def measured_by_prediction(board: Board, best: Scored) -> Measured:
    """In open loop: logged signals predicted from each other, in folds that nothing was fitted to."""
    nothing = calibrated(board, null_of(board))
    changes = gap_changes(board, None, best)
    left = tuple(
        GapLeft(gap=g.gap, unit=g.unit, left=g.after, floor=g.floor, ratio=g.after / g.floor if g.floor > 0.0 else None)
        for g in changes
    )
    each = {}
    for term in best.terms:
        # Errors refitted without it: what they can take up of it, it does not close.
        less = calibrated(board, Scorer(board, [t for t in best.terms if t is not term]).now)
        each[term.effect.name] = Consequences(loop="open", gaps=gap_changes(board, less, best))
    return Measured(
        Consequences(loop="open", gaps=changes),
        Consequences(loop="open", gaps=gap_changes(board, None, nothing)),
        each,
        left,
    )


def _less(effect: str) -> str:
    return f"without {effect}"
