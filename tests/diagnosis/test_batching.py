"""Models side by side in one batch move as each would alone."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.closed_loop.simulation import SensorNoise, merged, simulate
from diagnosis.library.registry import LIBRARY
from spot_model.effects.base import Effect
from spot_model.effects.bodies import PayloadMass
from spot_model.effects.commands import CommandDelay
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.estimator import VelocityEstimate
from spot_model.effects.friction import Armature, CoulombFriction
from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import load_policy
from spot_model.robot import facts

from .cases import CASES, Case
from .standing_starts import POLICY, scripts

SILENT = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (PayloadMass(mass_kg=2.0), PayloadMass(mass_kg=5.0)),
        (CoulombFriction(joints=("knees",), level_nm=0.5), CoulombFriction(joints=("knees",), level_nm=2.0)),
        (CommandDelay(delay_s=0.004), CommandDelay(delay_s=0.011)),
        (VelocityEstimate(scale=0.9), VelocityEstimate(scale=1.1)),
    ],
)
def test_one_batch_is_as_two(one: Effect, other: Effect) -> None:
    policy = load_policy(POLICY)
    models = [RobotModel((Armature(inertia_kg_m2=0.03), e)) for e in (one, other)]
    both = merged(models)
    assert both is not None
    together = simulate(both, policy, scripts(25), np.random.default_rng(0), SILENT)
    for model, run, script in zip(models, together, scripts(25), strict=True):
        (alone,) = simulate(model, policy, [script], np.random.default_rng(0), SILENT)
        assert np.allclose(alone.states.position_rad, run.states.position_rad, atol=1e-6)
    assert not np.allclose(alone.states.position_rad, together[0].states.position_rad, atol=1e-6)


def test_models_of_other_effects_or_joints_stand_side_by_side() -> None:
    knees, hips = (RobotModel((CoulombFriction(joints=(j,), level_nm=1.0),)) for j in ("knees", "hips"))
    both = merged([knees, hips, RobotModel()])
    assert both is not None
    levels = {e.joints: np.ravel(e.values["level_nm"]).tolist() for e in both.effects}
    assert levels == {("knees",): [1.0, 0.0, 0.0], ("hips",): [0.0, 1.0, 0.0]}
    assert merged([knees, knees]) is knees
    per_run = RobotModel((CoulombFriction(level_nm=np.ones((3, 1))),))
    assert merged([per_run, knees]) is None


def test_a_number_for_each_joint_stands_beside_one_for_all() -> None:
    by_joint = RobotModel((TorqueGain(gain=np.linspace(0.9, 1.1, 12)[None]),))
    both = merged([by_joint, RobotModel((TorqueGain(gain=0.8),)), RobotModel()])
    assert both is not None
    gain = both.effects[0].values["gain"]
    np.testing.assert_allclose(gain, [np.linspace(0.9, 1.1, 12), np.full(12, 0.8), np.ones(12)])


def test_effects_keep_their_order() -> None:
    a, b, c = Armature(inertia_kg_m2=0.1), CoulombFriction(level_nm=1.0), PayloadMass(mass_kg=1.0)
    both = merged([RobotModel((a, c)), RobotModel((b, c)), RobotModel((c, a))])
    assert both is not None
    assert [e.name for e in both.effects] == ["coulomb_friction", "armature", "payload_mass", "armature"]
    assert np.ravel(both.effects[1].values["inertia_kg_m2"]).tolist() == [0.1, 0.0, 0.0]
    assert np.ravel(both.effects[3].values["inertia_kg_m2"]).tolist() == [0.0, 0.0, 0.1]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.label)
def test_beside_any_effect_a_run_without_it_moves_as_ever(case: Case) -> None:
    entry = LIBRARY[case.effect]
    model = RobotModel((entry.make(case.values, case.joints),))
    both = merged([RobotModel(), model])
    assert both is not None
    plants = [Plant(m.effects, n, PlantOptions()) for m, n in ((both, 2), (RobotModel(), 1))]
    for plant in plants:
        for k in range(12):
            plant.step(facts.DEFAULT_POSITION_RAD + 0.3 * np.sin(0.7 * k), 4)
    np.testing.assert_array_equal(plants[0].joint_position_rad[0], plants[1].joint_position_rad[0])
    np.testing.assert_array_equal(plants[0].reading.velocity_rad_s[0], plants[1].reading.velocity_rad_s[0])
