"""Effects that could stand in for each other, and such as could not."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.selection.scoring import Placed, Scorer, likeness
from diagnosis.verdict.evidence import evidence_of
from spot_model.effects.friction import CoulombFriction

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence


def test_friction_is_like_other_friction_and_not_like_a_payload() -> None:
    runs = planted_runs(Truth((CoulombFriction(joints=("knees",), level_nm=3.0),)), 3, sequence=walk_sequence(3.0))
    board = evidence_of(runs, NOMINAL, None, LIBRARY)[3]
    knees = np.array([name.endswith("kn") for name in board.robot.joint_names], dtype=np.float64)
    by_speed, by_load = LIBRARY["coulomb_friction"], LIBRARY["load_friction"]
    terms = [Placed(by_speed, dict(by_speed.shapes(board.views, knees > 0.5)[0]), knees)]
    terms += [Placed(by_load, dict(by_load.shapes(board.views, knees > 0.5)[0]), knees)]
    payload = LIBRARY["payload_mass"]
    terms.append(Placed(payload, dict(payload.shapes(board.views, knees > 0.5)[0]), np.ones(1)))
    found = likeness(Scorer(board, terms))
    assert np.diag(found) == pytest.approx(1.0)
    assert found[0, 1] > 0.2
    assert found[0, 2] < 0.1
