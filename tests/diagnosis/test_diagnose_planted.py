"""Selection on logs with a planted truth, *set-point to load* alone: the effect, its joints and its size come back."""

import numpy as np
import pytest

from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.scoring import Scorer
from diagnosis.selection.search import search_effects
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import CoulombFriction

from .cases import drive_evidence

NAMES = (
    "coulomb_friction",
    "viscous_friction",
    "torque_gain",
    "armature",
    "load_friction",
    "torque_limit",
    "stribeck_friction",
)
SMALL = {name: LIBRARY[name] for name in NAMES}


@pytest.fixture(scope="module")
def two_effects() -> Evidence:
    return drive_evidence(CoulombFriction(joints=("fl_kn",), level_nm=3.0), TorqueGain(joints=("hy",), gain=0.8))[1]


def test_two_effects_are_found_with_their_joints(two_effects: Evidence) -> None:
    found = search_effects(two_effects, SMALL, lambda _: None)
    robot = two_effects.robot
    joints = {t.effect.name: robot.named(robot.joints_of(t.effect, t.place)) for t in found.best.terms}
    assert joints == {"coulomb_friction": ("fl_kn",), "torque_gain": ("fl_hy", "fr_hy", "hl_hy", "hr_hy")}
    values = {
        t.effect.name: t.effect.values(c, t.shape)
        for t, c in zip(found.best.terms, found.best.coefficients, strict=True)
    }
    # A knee that sticks is no column: least squares say 2.5 N·m, and this is twice the realistic range.
    assert values["coulomb_friction"]["level_nm"] == pytest.approx(3.0, rel=0.25)
    assert values["torque_gain"]["gain"] == pytest.approx(0.8, abs=0.04)


def test_without_an_effect_nothing_is_found() -> None:
    found = search_effects(drive_evidence()[1], SMALL, lambda _: None)
    assert found.best.terms == ()


def test_what_a_nominal_model_is_usually_off_by_is_no_finding() -> None:
    gain = ERROR_SCALES["torque_gain"].scales["gain"]
    found = search_effects(drive_evidence(TorqueGain(joints=("fl_kn",), gain=1.0 - gain))[1], SMALL, lambda _: None)
    assert found.best.terms == ()


def test_an_ordinary_error_is_taken_up_at_its_joints() -> None:
    usual = ERROR_SCALES["torque_gain"].scales["gain"]
    board = drive_evidence(TorqueGain(joints=("kn",), gain=1.0 - usual))[1]
    kind = next(k for k in board.ordinary.kinds if k.effect.name == "torque_gain")
    found = kind.coefficients(Scorer(board).now.pulls * board.ordinary.scale)[:, 0]
    knees = np.array([name.endswith("kn") for name in board.robot.joint_names])
    assert found[knees] == pytest.approx(-usual, abs=0.3 * usual)
    assert np.abs(found[~knees]).max() < 0.3 * usual


def test_many_places_at_once_are_ranked_as_one_by_one(two_effects: Evidence) -> None:
    scorer, effect = Scorer(two_effects), LIBRARY["coulomb_friction"]
    joint = two_effects.robot.joint_names.index("fl_kn")
    places = np.eye(12)
    weights = scorer.scored(effect, {}, places[joint]).weights
    assert int(np.argmax(scorer.gains(effect, {}, places, weights))) == joint
    assert max(range(12), key=lambda i: scorer.scored(effect, {}, places[i]).value) == joint
