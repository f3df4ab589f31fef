"""Which effects are differences, and which could stand in for each other."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.faultless import FAULTLESS
from diagnosis.selection.scoring import Placed, Scorer, likeness
from diagnosis.verdict import belief
from diagnosis.verdict.belief import CALIBRATED, decide, probabilities
from diagnosis.verdict.explanation import Explanation, weigh
from spot_model.effects.friction import CoulombFriction

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence

FEW = {name: LIBRARY[name] for name in ("coulomb_friction", "armature")}
MORE = {n: LIBRARY[n] for n in (*FEW, "torque_gain", "viscous_friction", "payload_mass", "leg_mass", "backlash")}


@pytest.fixture(scope="module")
def rubbing() -> Explanation:
    friction = CoulombFriction(joints=("knees",), level_nm=3.0)
    runs = planted_runs(Truth((friction,)), 3, sequence=walk_sequence(3.0))
    return weigh(runs, NOMINAL, None, FEW, lambda _: None)


def test_residuals_decide_what_is_there(rubbing: Explanation) -> None:
    decided = decide(rubbing, FEW)
    assert decided.stated == "coulomb_friction"
    assert decided.there["coulomb_friction"] > 0.8
    assert set(decided.sets) == {"coulomb_friction", CALIBRATED}
    assert sum(weight for _, weight in decided.sets.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("unknown", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("left", [0.0, 30.0, 3000.0])
def test_an_effect_answers_for_its_share_where_something_unknown_may_be_in_its_place(
    rubbing: Explanation, monkeypatch: pytest.MonkeyPatch, unknown: float, left: float
) -> None:
    channels = rubbing.selection.channels["coulomb_friction"]
    gain = rubbing.selection.gains["coulomb_friction"] + FAULTLESS.price("coulomb_friction")
    monkeypatch.setattr(belief, "probability", lambda _: 0.0)
    before = probabilities(rubbing)["coulomb_friction"]
    assert channels[Channel.SET_POINT_TO_LOAD] > 10.0
    monkeypatch.setattr(belief, "probability", lambda _: unknown)
    # What is left of channels in which friction does not show is no matter of friction.
    monkeypatch.setattr(
        belief, "nats_left", lambda *_: {c: left if c == Channel.SET_POINT_TO_LOAD else 0.0 for c in channels}
    )
    expected = before * (1.0 - unknown * left / (left + gain))
    assert probabilities(rubbing)["coulomb_friction"] == pytest.approx(expected, abs=1e-3)
    monkeypatch.setattr(
        belief, "nats_left", lambda *_: {c: left if own < belief.SHOWS else 0.0 for c, own in channels.items()}
    )
    assert probabilities(rubbing)["coulomb_friction"] == pytest.approx(before, abs=1e-3)


def test_what_is_probably_not_there_is_left_out() -> None:
    runs = planted_runs(Truth(()), 3, sequence=walk_sequence(3.0))
    decided = decide(weigh(runs, NOMINAL, None, MORE, lambda _: None), MORE)
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
