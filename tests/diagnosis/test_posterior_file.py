"""Robots drawn from a posterior: sets by their weights, numbers by their covariances."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.verdict.posterior_file import LEAST, Possibility, Posterior, Term, is_right
from diagnosis.verdict.probability import Belief
from spot_model.effects.drivetrain import TorqueGain
from spot_model.io.model_file import RobotModel

BASE = RobotModel((TorqueGain(joints=("fl_hx",), gain=1.03),)).to_data()


def _friction(weight: float, sd: float) -> Possibility:
    term = Term(effect="coulomb_friction", joints=("knees",), shape={}, mean=(1.0,), covariance=((sd**2,),))
    return Possibility(weight=weight, distance_floors=1.2, model=BASE, terms=(term,))


def test_sets_come_by_their_weights_and_numbers_by_their_spread() -> None:
    nothing = Possibility(weight=0.25, distance_floors=3.0, model=BASE, terms=())
    posterior = Posterior(possibilities=(nothing, _friction(0.75, 0.1)))
    rng = np.random.default_rng(0)
    models = [posterior.draw(LIBRARY, rng) for _ in range(400)]
    assert all(m.effects[0] == TorqueGain(joints=("fl_hx",), gain=1.03) for m in models)
    levels = [m.effects[1].values["level_nm"] for m in models if len(m.effects) == 2]
    assert len(levels) == pytest.approx(300, abs=30)
    assert np.mean(levels) == pytest.approx(1.0, abs=0.02)
    assert np.std(levels) == pytest.approx(0.1, abs=0.015)


def test_numbers_keep_within_their_bounds() -> None:
    posterior = Posterior(possibilities=(_friction(1.0, 5.0),))
    rng = np.random.default_rng(1)
    assert min(posterior.draw(LIBRARY, rng).effects[1].values["level_nm"] for _ in range(50)) >= 0.0


def test_a_file_comes_back_as_it_was() -> None:
    posterior = Posterior(possibilities=(_friction(1.0, 0.1),))
    assert Posterior.model_validate_json(posterior.model_dump_json(by_alias=True)) == posterior


def test_a_set_is_as_likely_as_each_of_its_effects_is_there_and_the_others_are_not() -> None:
    """Drag, or a gain in its place with half its weight, 0.9; a payload 0.9 beside it."""
    weights: dict[tuple[str, ...], float] = {("drag", "load"): 2.0, ("gain", "load"): 1.0}
    belief = Belief(("drag", "load"), {"drag": 0.9, "load": 0.9}, weights)
    odds = [is_right(belief, frozenset(s)) for s in ({"drag", "load"}, {"gain", "load"}, {"load"}, {"drag"}, set())]
    assert odds == pytest.approx([0.54, 0.27, 0.09, 0.06, 0.01])
    sure = Belief(("drag",), {"drag": 1.0}, {("drag",): 1.0})
    assert is_right(sure, frozenset()) == LEAST
