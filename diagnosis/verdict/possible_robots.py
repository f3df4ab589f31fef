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
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.robot_models import corrected_model, model_by_joint
from diagnosis.selection.scoring import Scored, bounds, by_term, posterior_covariance
from diagnosis.verdict.belief import Belief
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES

ROBOTS: Final = 32
"""Enough that each simulated batch meets all, and few enough that the file is read by people."""


def possible_robots(
    belief: Belief, nominal: RobotModel, around: Surroundings, rng: np.random.Generator, n: int = ROBOTS
) -> tuple[RobotModel, ...]:
    """Robots drawn from what was decided, of Spot alone.

    Args:
        belief: What was decided.
        nominal: The simulator's model.
        around: Surroundings that suit the corrected model.
        rng: Of all draws.
        n: How many.
    """
    board, sets = belief.found.board, list(belief.sets.values())
    chosen = rng.choice(len(sets), size=n, p=[weight for _, weight in sets])
    drawn = [own for i, (scored, _) in enumerate(sets) for own in _drawn(board, scored, int(np.sum(chosen == i)), rng)]
    return tuple(around.around(model_by_joint(corrected_model(nominal, board, own), JOINT_NAMES)) for own in drawn)


def _drawn(board: Evidence, scored: Scored, n: int, rng: np.random.Generator) -> list[Scored]:
    """The fit with other numbers that are as possible, n times."""
    if n == 0:
        return []
    q, sizes = len(scored.pulls), np.concatenate([np.zeros(0), *scored.coefficients])
    covariance = posterior_covariance(board, scored)
    covariance[q:, q:] += np.diag((PARAMETER_SPREAD * sizes) ** 2)
    numbers = rng.multivariate_normal(np.concatenate([scored.pulls, sizes]), covariance, size=n, method="eigh")
    numbers[:, q:] = np.clip(numbers[:, q:], *bounds([t.effect for t in scored.terms]))
    return [replace(scored, pulls=row[:q], coefficients=by_term(scored.terms, row[q:])) for row in numbers]
