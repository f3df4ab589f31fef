"""Models side by side in one batch move as each would alone."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.batching import merged
from diagnosis.simulated import SensorNoise, simulate
from spot_model.effects.armature import Armature
from spot_model.effects.base import Effect
from spot_model.effects.command_delay import CommandDelay
from spot_model.effects.coulomb_friction import CoulombFriction
from spot_model.effects.payload_mass import PayloadMass
from spot_model.effects.velocity_estimate import VelocityEstimate
from spot_model.model_file import RobotModel
from spot_model.policy import load_policy

from .report_case import POLICY, scripts

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


def test_models_of_other_effects_or_joints_stay_apart() -> None:
    knees, hips = (RobotModel((CoulombFriction(joints=(j,), level_nm=1.0),)) for j in ("knees", "hips"))
    assert merged([knees, hips]) is None
    assert merged([knees, RobotModel()]) is None
    assert merged([knees, knees]) is knees
