"""Fitted effects as parameters with intervals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from diagnosis.channels import Array
from diagnosis.decision_constants import PARAMETER_SPREAD
from diagnosis.document import Number
from diagnosis.library import Robot
from diagnosis.selection.evidence import Board
from diagnosis.selection.scoring import Placed, Scored, Scorer, without
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.joints import describe_joints

Z_90: Final = 1.645
PROFILE_NATS: Final = 1.35
"""A shape whose score is within this of the best is within its 90 % interval."""
NEVER_MET: Final = 1e5
"""Null values from here on stand for a limit that is never met."""


def joint_words(robot: Robot, term: Placed) -> tuple[str, ...]:
    """Joints of a term as a model file names them."""
    mask = robot.joints_of(term.effect, term.place)
    return describe_joints(mask) if robot.joint_names == JOINT_NAMES else robot.named(mask)


def without_effect(board: Board, scored: Scored, name: str) -> Scored:
    """The fit less one effect, and less what its joint types or legs have of it by ordinary errors.

    All other ordinary errors stay as they are beside it, so that models with it and without it differ by it alone.
    """
    for which in reversed([i for i, term in enumerate(scored.terms) if term.effect.name == name]):
        scored = without(scored, which)
    shared = np.zeros(len(scored.pulls), dtype=np.bool_)
    for kind in board.ordinary.kinds:
        if kind.effect.name == name:
            for k in range(len(kind.chosen)):
                shared[kind.columns(k)] = kind.alike
    return replace(
        scored, pulls=np.where(shared, 0.0, scored.pulls), fold_pulls=np.where(shared, 0.0, scored.fold_pulls)
    )


def numbers(scorer: Scorer, scored: Scored) -> dict[str, Number]:
    """Parameters of the last term beside the scorer's, each with a 90 % interval.

    Of a linear number it comes from leaving out one fold at a time; of a shape from the shapes nearby that score
    almost as well; of both from what a formula is usually wrong by, ``PARAMETER_SPREAD``.
    """
    term, own = scored.terms[-1], scored.coefficients[-1]
    size = len(own)
    folds = scored.spread[:, -size:]
    n = len(folds)
    error = np.sqrt((n - 1) / n * np.sum((folds - folds.mean(axis=0)) ** 2, axis=0))
    best = term.effect.values(own, term.shape)
    low, high = dict(best), dict(best)

    def widen(coefficients: Array, shape: dict[str, float]) -> None:
        for name, value in term.effect.values(coefficients, shape).items():
            low[name], high[name] = min(low[name], value), max(high[name], value)

    for i, c in enumerate(term.effect.coefficients):
        for sign in (-1.0, 1.0):
            moved = own.copy()
            moved[i] = np.clip(moved[i] + sign * Z_90 * error[i], c.low, c.high)
            widen(moved, dict(term.shape))
    for shape in term.effect.refined(term.shape):
        other = scorer.scored(term.effect, shape, term.place)
        if other.score > scored.score - PROFILE_NATS:
            widen(other.coefficients[-1], dict(shape))
    units = {p.name: p.unit for p in term.effect.effect.parameters()}
    nulls = {p.name: p.null for p in term.effect.effect.parameters()}
    found = {}
    for name, v in best.items():
        wide = with_formula_error(float(v), float(low[name]), float(high[name]), nulls.get(name, 0.0))
        found[name] = Number(value=float(v), low=wide[0], high=wide[1], unit=units.get(name, ""))
    return found


def with_formula_error(value: float, low: float, high: float, null: float) -> tuple[float, float]:
    """An interval widened by what formulas are usually wrong by, counted from where the effect vanishes.

    The null value of a limit that is never met is no place to count from; zero is, then.
    """
    formula = Z_90 * PARAMETER_SPREAD * abs(value - null if abs(null) < NEVER_MET else value)
    return value - math.hypot(value - low, formula), value + math.hypot(high - value, formula)
