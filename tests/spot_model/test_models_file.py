"""Models side by side: each simulation is bit for bit the robot of its own model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spot_model.effects.base import Effect
from spot_model.effects.commands import CommandDrop, CommandJitter
from spot_model.effects.friction import Armature, CoulombFriction, ViscousFriction
from spot_model.effects.joint_sensors import SensorNoise
from spot_model.effects.side_by_side import side_by_side
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, load_model
from spot_model.io.models_file import load_models, save_models
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts

from .test_effects import ACTIVE

RANDOM = (CommandJitter, CommandDrop, SensorNoise)


def walk(effects: tuple[Effect, ...], n: int) -> np.ndarray:
    plant = Plant(effects, n, PlantOptions(n_threads=1))
    rng = np.random.default_rng(5)
    for _ in range(12):
        plant.step(facts.DEFAULT_POSITION_RAD + 0.15 * rng.standard_normal(12), 4)
    return np.concatenate([plant.joint_position_rad, plant.reading.position_rad, plant.reading.load_nm], axis=-1)


@pytest.mark.parametrize("effect", [e for e in ACTIVE if not isinstance(e, RANDOM)], ids=lambda e: e.name)
def test_a_robot_without_an_effect_does_not_feel_its_neighbours(effect: Effect) -> None:
    paper = load_model("paper_identified")
    models = (paper, paper.with_effects(effect))
    together = walk(side_by_side([m.effects for m in models], 4), 4)
    for i, model in enumerate(models):
        alone = walk(model.effects, 1)[0]
        np.testing.assert_allclose(together[i], alone, atol=1e-9)
        np.testing.assert_array_equal(together[i + 2], together[i])


def test_effects_keep_the_order_of_each_model() -> None:
    a, b, c = CoulombFriction(level_nm=1.0), Armature(inertia_kg_m2=0.1), ViscousFriction(damping_nm_s_per_rad=0.2)
    names = [e.name for e in side_by_side(((a, b), (a, c, b), (a, a)), 3)]
    assert names == [a.name, c.name, b.name, a.name]
    first, second = (e for e in side_by_side(((a,), (a, a)), 3) if e.name == a.name)
    np.testing.assert_array_equal(first.level_nm, [[1.0], [1.0], [1.0]])
    np.testing.assert_array_equal(second.level_nm, [[0.0], [1.0], [0.0]])


def test_a_models_file_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "robots.yaml"
    models = (load_model("paper_identified"), RobotModel((CoulombFriction(joints=("knees",), level_nm=0.5),)))
    save_models(models, path)
    assert load_models(str(path)) == models
    assert load_models("paper_initial") == (load_model("paper_initial"),)
    (tmp_path / "none.yaml").write_text("schema: spot-rl/models/1\nmodels: []\n")
    with pytest.raises(BadInputError, match="models"):
        load_models(str(tmp_path / "none.yaml"))
    (tmp_path / "wrong.yaml").write_text("schema: spot-rl/models/1\nmodels: [{effects: [{effect: magic}]}]\n")
    with pytest.raises(BadInputError, match=r"models\.0.*magic"):
        load_models(str(tmp_path / "wrong.yaml"))
