"""Robots to simulate: drawn from the posterior, or from the published ranges of ordinary errors alone."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library import Robot
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.ordinary_errors import ErrorKind, error_sets
from diagnosis.selection.robot_models import with_kind
from diagnosis.verdict.posterior_file import Possibility, Posterior
from spot_model.effects import side_by_side
from spot_model.effects.bodies import PayloadMass
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from spot_model.robot.joints import select_joints

SPOT: Final = Robot(facts.JOINT_NAMES, np.repeat(np.arange(facts.N_LEGS), 3))
LEFT: Final = 0.5
"""Share of the published range of ordinary errors that the first logs leave open. Not calibrated."""
WIDE: Final = 2.0
"""Share of the published range that robots for the safety check alone are drawn from."""
N_WIDE: Final = 50
LIKELY: Final = 0.01
"""Causes below this weight are left out."""
MOST_CAUSES: Final = 4
SETTLED: Final = frozenset({"velocity_estimate", "imu_tilt", "velocity_filter", "command_jitter"})
"""Ordinary errors that robots of the posterior keep as the logs gave them: varying them costs more than it tells."""

Cause = tuple[str, ...]
"""Names of effects, in alphabetical order; none for the robot's calibration alone."""


@dataclass(frozen=True)
class Robots:
    """Robots that the logs allow, as many of each cause."""

    causes: tuple[Cause, ...]
    weights: np.ndarray
    """Weights of the causes, shape (C,), adding up to 1."""
    models: tuple[RobotModel, ...]
    cause_of: np.ndarray
    """Index of each model's cause, shape (n,)."""
    wide: tuple[RobotModel, ...]
    """Robots of any of the causes, with wide errors, for safety alone."""


def cause_of(possibility: Possibility) -> Cause:
    """The effects of a possibility."""
    return tuple(sorted({t.effect for t in possibility.terms}))


def all_beliefs(posterior: Posterior) -> dict[Cause, float]:
    """Probability of each cause, the likeliest first."""
    found: dict[Cause, float] = {}
    for possibility in posterior.possibilities:
        cause = cause_of(possibility)
        found[cause] = found.get(cause, 0.0) + possibility.weight
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def beliefs(posterior: Posterior) -> dict[Cause, float]:
    """The likeliest causes, which experiments are chosen to tell apart; adds up to 1."""
    ranked = [(c, w) for c, w in all_beliefs(posterior).items() if w >= LIKELY][:MOST_CAUSES]
    total = sum(w for _, w in ranked)
    return {c: w / total for c, w in ranked}


def suspects(posterior: Posterior) -> tuple[str, ...]:
    """Joints at which effects may act, the likeliest first; of many alike, those of one leg."""
    odds = dict.fromkeys(facts.JOINT_NAMES, 0.0)
    for possibility in posterior.possibilities:
        for term in possibility.terms:
            chosen = np.array(facts.JOINT_NAMES)[select_joints(term.joints)]
            for name in chosen:
                odds[name] += possibility.weight / len(chosen)
    ranked = sorted((n for n in odds if odds[n] > 0.0), key=lambda n: -odds[n])
    return tuple(ranked) or facts.JOINT_NAMES[:3]


def drawn_robots(posterior: Posterior, each: int, rng: np.random.Generator) -> Robots:
    """Robots, ``each`` of every likely cause, with ordinary errors that the logs leave open; and wide ones."""

    def drawn(source: Posterior, share: float) -> RobotModel:
        return with_ordinary_errors(compact(source.draw(LIBRARY, rng)), rng, share, without=SETTLED)

    odds = beliefs(posterior)
    models: list[RobotModel] = []
    for cause in odds:
        own = Posterior(possibilities=tuple(p for p in posterior.possibilities if cause_of(p) == cause))
        models += [drawn(own, LEFT) for _ in range(each)]
    wide = tuple(drawn(posterior, WIDE) for _ in range(N_WIDE))
    index = np.repeat(np.arange(len(odds)), each)
    return Robots(tuple(odds), np.array(list(odds.values())), tuple(models), index, wide)


def with_ordinary_errors(
    model: RobotModel, rng: np.random.Generator, share: float = 1.0, without: Collection[str] = ()
) -> RobotModel:
    """The model with ordinary errors drawn from a share of their published ranges, some left out by name."""
    for name, given in ERROR_SCALES.items():
        if name in without:
            continue
        effect = LIBRARY[name]
        scale = np.array([given.scales.get(c.name, 0.0) for c in effect.coefficients])
        chosen, sets = np.flatnonzero(scale > 0.0), error_sets(SPOT, effect)
        kind = ErrorKind(effect, given.at, 0, tuple(sets), chosen)
        size = np.array([scale[k] * (given.alike if s.sum() > 1 else 1.0) for s in sets for k in chosen])
        model = with_kind(model, SPOT, kind, kind.coefficients(share * size * rng.standard_normal(len(size))))
    # A mass is missing in the body's middle: far from it, its inertia would exceed the body's own.
    possible = [
        replace(e, x_m=0.0, y_m=0.0, z_m=0.0) if isinstance(e, PayloadMass) and e.mass_kg < 0.0 else e
        for e in model.effects
    ]
    return replace(model, effects=tuple(possible))


def compact(model: RobotModel) -> RobotModel:
    """The same robot with effects of one kind at single joints as one; see :mod:`spot_model.effects.side_by_side`."""
    return replace(model, effects=side_by_side.compact(model.effects))
