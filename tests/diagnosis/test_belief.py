"""Which effects are differences, and which could stand in for each other."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.selection.scoring import Placed, Scorer, likeness
from diagnosis.verdict.belief import CALIBRATED, decide
from diagnosis.verdict.explanation import Explanation, explain
from spot_model.effects.friction import CoulombFriction

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence

FEW = {name: LIBRARY[name] for name in ("coulomb_friction", "armature")}
MORE = {n: LIBRARY[n] for n in (*FEW, "torque_gain", "viscous_friction", "payload_mass", "leg_mass", "backlash")}


@pytest.fixture(scope="module")
def rubbing() -> Explanation:
    friction = CoulombFriction(joints=("knees",), level_nm=3.0)
    runs = planted_runs(Truth((friction,)), 3, sequence=walk_sequence(3.0))
    return explain(runs, NOMINAL, None, FEW, lambda _: None)


def test_residuals_decide_what_is_there(rubbing: Explanation) -> None:
    decided = decide(rubbing, FEW)
    assert decided.stated == "coulomb_friction"
    assert decided.there["coulomb_friction"] > 0.8
    assert set(decided.sets) == {"coulomb_friction", CALIBRATED}
    assert sum(weight for _, weight in decided.sets.values()) == pytest.approx(1.0)


def test_what_is_probably_not_there_is_left_out() -> None:
    runs = planted_runs(Truth(()), 3, sequence=walk_sequence(3.0))
    decided = decide(explain(runs, NOMINAL, None, MORE, lambda _: None), MORE)
    assert decided.stated == CALIBRATED
    assert decided.found.selection.best.terms == ()


def test_friction_is_like_other_friction_and_not_like_a_payload(rubbing: Explanation) -> None:
    board = rubbing.board
    knees = np.array([name.endswith("kn") for name in board.robot.joint_names], dtype=np.float64)
    places = {"coulomb_friction": knees, "load_friction": knees, "payload_mass": np.ones(1)}
    entries = {LIBRARY[name]: place for name, place in places.items()}
    terms = [Placed(e, dict(e.shapes(board.views, knees > 0.5)[0]), place) for e, place in entries.items()]
    found = likeness(Scorer(board, terms), list(places))
    assert np.diag(found) == pytest.approx(1.0)
    assert found[0, 1] > 0.1
    assert found[0, 2] < 0.01
