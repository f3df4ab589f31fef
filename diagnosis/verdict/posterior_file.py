"""The posterior as a file: sets of effects with weights, their numbers with covariances.

``posterior.json`` holds what is still possible after the logs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from diagnosis.channels import Array
from diagnosis.closed_loop.environment import Surroundings
from diagnosis.decision_constants import PARAMETER_SPREAD
from diagnosis.selection.robot_models import model_by_joint, with_errors
from diagnosis.selection.scoring import posterior_covariance
from diagnosis.verdict.belief import Belief
from spot_model.io.model_file import RobotModel
from spot_model.io.settings import Settings
from spot_model.robot.facts import JOINT_NAMES


class PosteriorTerm(Settings):
    """An effect of a set, and what its numbers may be."""

    effect: str
    joints: tuple[str, ...]
    shape: dict[str, float]
    mean: tuple[float, ...]
    """Coefficients, in the order of the library's entry."""
    covariance: tuple[tuple[float, ...], ...]


class Possibility(Settings):
    """A set of effects."""

    weight: float = Field(ge=0.0, le=1.0)
    distance_floors: float | None
    model: dict[str, Any]
    """Model file's data: the nominal model with this robot's ordinary errors, without the effects."""
    terms: tuple[PosteriorTerm, ...]


class Posterior(Settings):
    """All sets that were compared; weights add up to 1."""

    schema_name: Literal["spot-rl/posterior/2"] = Field(default="spot-rl/posterior/2", alias="schema")
    possibilities: tuple[Possibility, ...] = Field(min_length=1)
    unknown: float = Field(default=0.0, ge=0.0, le=1.0)
    """Probability of something that no effect of the library is."""

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Posterior:
        if not sum(p.weight for p in self.possibilities) > 0.0:
            raise ValueError("the weights of the possibilities add up to 0; one has to be above")
        for term in (term for p in self.possibilities for term in p.terms):
            n = len(term.mean)
            if [len(row) for row in term.covariance] != [n] * n:
                raise ValueError(f"the covariance of {term.effect} is not {n} × {n}, as it has {n} coefficients")
        return self


def posterior_of(
    belief: Belief, nominal: RobotModel, around: Surroundings, unknown: float, distances: Mapping[str, float]
) -> Posterior:
    """What was decided, as data; of Spot alone, since only Spot is simulated.

    Args:
        belief: What was decided.
        nominal: The simulator's model.
        around: Surroundings that suit the corrected model.
        unknown: Probability of something that no effect of the library is.
        distances: Of closed loops by name of the model, in floors.
    """
    board, found = belief.found.board, []
    for name, (scored, weight) in belief.sets.items():
        covariance = posterior_covariance(board, scored)[len(scored.pulls) :, len(scored.pulls) :]
        ends = np.cumsum([len(c) for c in scored.coefficients])
        base = around.around(model_by_joint(with_errors(nominal, board, scored.pulls), JOINT_NAMES))
        terms = tuple(
            PosteriorTerm(
                effect=t.effect.name,
                joints=board.robot.words_for(t.effect, t.place),
                shape={k: float(v) for k, v in t.shape.items()},
                mean=tuple(float(v) for v in own),
                covariance=tuple(tuple(float(v) for v in row) for row in _wider(covariance, ends[i], own)),
            )
            for i, (t, own) in enumerate(zip(scored.terms, scored.coefficients, strict=True))
        )
        far = distances.get(name)
        found.append(Possibility(weight=weight, distance_floors=far, model=base.to_data(), terms=terms))
    return Posterior(possibilities=tuple(found), unknown=unknown)


def _wider(covariance: Array, end: int, own: Array) -> Array:
    """Covariance of the coefficients that end there, with what formulas are usually wrong by."""
    mine = slice(end - len(own), end)
    return np.asarray(covariance[mine, mine] + np.diag((PARAMETER_SPREAD * own) ** 2))
