"""Robots that the logs allow, for training and trials: sets of effects by their weight, all numbers drawn together.

A robot's ordinary errors and the sizes of its effects are drawn from their joint covariance, so that what the logs
cannot tell apart is drawn as it trades off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from diagnosis.closed_loop.environment import Surroundings
from diagnosis.decision_constants import PARAMETER_SPREAD
from diagnosis.selection.calibrated import calibrated, free_types, posterior_covariance
from diagnosis.selection.robot_models import by_joint, model_of
from diagnosis.selection.scoring import Scored, bounds, by_term
from diagnosis.verdict.causes import Causes
from diagnosis.verdict.posterior_file import weights_of_sets
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES

ROBOTS: Final = 32
"""Enough that each simulated batch meets all, and few enough that the file is read by people."""


def possible_robots(
    causes: Causes, nominal: RobotModel, around: Surroundings, rng: np.random.Generator, n: int = ROBOTS
) -> tuple[RobotModel, ...]:
    """Robots drawn from what was decided, of Spot alone.

    Args:
        causes: What was decided.
        nominal: The simulator's model.
        around: Surroundings that suit the corrected model.
        rng: Of all draws.
        n: How many.
    """
    weights = weights_of_sets(causes)
    chosen = rng.choice(len(weights), size=n, p=list(weights.values()))
    found: list[RobotModel] = []
    for index, name in enumerate(weights):
        drawn = _drawn(causes, causes.hypotheses[name], int(np.sum(chosen == index)), rng)
        board = causes.found.board
        found += [around.around(by_joint(model_of(nominal, board, own), JOINT_NAMES)) for own in drawn]
    return tuple(found)


def _drawn(causes: Causes, scored: Scored, n: int, rng: np.random.Generator) -> list[Scored]:
    """The fit with other numbers that are as possible, n times."""
    if n == 0:
        return []
    board = causes.found.board
    own = calibrated(board, scored)
    q, sizes = len(own.pulls), np.concatenate([np.zeros(0), *own.coefficients])
    covariance = posterior_covariance(board, own, free_types(board))
    covariance[q:, q:] += np.diag((PARAMETER_SPREAD * sizes) ** 2)
    numbers = rng.multivariate_normal(np.concatenate([own.pulls, sizes]), covariance, size=n, method="eigh")
    numbers[:, q:] = np.clip(numbers[:, q:], *bounds([t.effect for t in own.terms]))
    return [replace(own, pulls=row[:q], coefficients=by_term(own.terms, row[q:])) for row in numbers]
