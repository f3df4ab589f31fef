"""Rollouts are the same bits in one process and in two, and what surrounds them acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.closed_loop.environment import Surroundings
from diagnosis.closed_loop.simulation import (
    Rollout,
    RolloutEngine,
    merged_models,
    rollouts_under,
    run_all,
    simulate_all,
)
from diagnosis.library.registry import LIBRARY
from spot_log.read.run import Run
from spot_model.effects.base import Effect, Parameter
from spot_model.effects.bodies import PayloadMass
from spot_model.effects.commands import CommandDelay, CommandJitter
from spot_model.effects.drivetrain import TorqueGain, TorqueOffset
from spot_model.effects.estimator import VelocityEstimate
from spot_model.effects.friction import Armature, CoulombFriction, StribeckFriction
from spot_model.effects.joint_sensors import SensorNoise as NoisyCells
from spot_model.effects.power import BusSag
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from trainer.simulate.engine import Place, ignore
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts

from .cases import CASES, Case
from .planted import POLICY, scripts

MODEL = RobotModel((CoulombFriction(joints=("knees",), level_nm=1.0),))


@pytest.fixture(scope="module")
def policy() -> Policy:
    return load_policy(POLICY)


def _rollouts(model: RobotModel = MODEL) -> list[Rollout]:
    return [Rollout(model, tuple(scripts(20)), 3), Rollout(RobotModel(), tuple(scripts(20))[:1], 4)]


def _same(one: Sequence[Run], other: Sequence[Run]) -> bool:
    """Whether runs have the same tables, bit for bit."""

    def columns(run: Run) -> list[np.ndarray]:
        tables = (run.states, run.ticks, run.commands)
        return [v for table in tables for v in vars(table).values() if isinstance(v, np.ndarray)]

    pairs = [(a, b) for r, s in zip(one, other, strict=True) for a, b in zip(columns(r), columns(s), strict=True)]
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in pairs)


def _many_runs(engine: RolloutEngine) -> list[Run]:
    """Runs of models with random effects, beside each other; some end before the others."""
    models = [
        RobotModel((CommandJitter(mean_s=0.002 * (i % 2)), NoisyCells(load_nm=0.5 * (i % 3)), *MODEL.effects[: i % 2]))
        for i in range(5)
    ]
    jobs = [(m, s) for i, m in enumerate(models) for s in scripts(12 if i % 2 else 20)]
    return run_all(jobs, engine, np.random.default_rng(7), ignore)


def test_a_rollout_depends_on_itself_alone(policy: Policy) -> None:
    told: list[float] = []
    both = rollouts_under(policy).map(_rollouts(), told.append)
    alone = [rollouts_under(policy).map([r])[0] for r in _rollouts()]
    assert [len(part) for part in both] == [2, 1]
    assert all(_same(a, b) for a, b in zip(both, alone, strict=True))
    assert told == sorted(told)
    assert 0.0 <= told[0] < told[-1] < 1.0


def test_the_number_of_workers_changes_no_bit(policy: Policy) -> None:
    told: list[float] = []
    whole = _many_runs(rollouts_under(policy))
    with rollouts_under(policy, Place(workers=2)) as engine:
        assert engine.parts(10) == 2
        assert _same(_many_runs(engine), whole)
        simulate_all(_rollouts(), engine, told.append)
    assert told[-1] == 1.0


def test_a_large_batch_is_cut_into_the_same_jobs_for_any_number_of_workers() -> None:
    levels = np.linspace(0.0, 1.0, 10)[:, None]
    model = RobotModel((CoulombFriction(joints=("knees",), level_nm=levels), NoisyCells(load_nm=1.0)))
    whole = Rollout(model, tuple(scripts(5) * 5), 3)
    parts = whole.split(4)
    assert [len(part.scripts) for part in parts] == [4, 4, 2]
    assert [part.seed for part in parts] == [3, 4, 5]
    assert [part.model.effects[0].values["level_nm"].tolist() for part in parts] == [
        levels[i : i + 4].tolist() for i in (0, 4, 8)
    ]
    assert whole.split(10) == [whole]


def test_a_policy_without_a_file_is_refused(policy: Policy) -> None:
    with pytest.raises(BadInputError, match="has no file"):
        rollouts_under(replace(policy, file_bytes=b""))


@pytest.mark.parametrize(
    "other",
    [
        {"contact_time_constant_s": 0.045},
        {"contact_damping_ratio": 0.7},
        {"friction_scale": 0.4},
        {"odometry_time_s": 0.05},
    ],
)
def test_surroundings_act_and_their_own_values_change_no_bit(policy: Policy, other: dict[str, float]) -> None:
    engine = rollouts_under(policy)
    plain = engine.map(_rollouts()[:1])[0]
    own = Surroundings().around(MODEL)
    assert _same(plain, engine.map(_rollouts(own)[:1])[0])
    assert not _same(plain, engine.map(_rollouts(Surroundings(**other).around(MODEL))[:1])[0])


SILENT = UsualNoise(0.0, 0.0, 0.0, 0.0, 0.0)


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
    both = merged_models(models)
    assert both is not None
    together = simulate_scripts(both, policy, scripts(25), np.random.default_rng(0), SILENT)
    for model, run, script in zip(models, together, scripts(25), strict=True):
        (alone,) = simulate_scripts(model, policy, [script], np.random.default_rng(0), SILENT)
        assert np.allclose(alone.states.position_rad, run.states.position_rad, atol=1e-6)
    assert not np.allclose(alone.states.position_rad, together[0].states.position_rad, atol=1e-6)


def test_models_of_other_effects_or_joints_stand_side_by_side() -> None:
    knees, hips = (RobotModel((CoulombFriction(joints=(j,), level_nm=1.0),)) for j in ("knees", "hips"))
    both = merged_models([knees, hips, RobotModel()])
    assert both is not None
    levels = {e.joints: np.ravel(e.values["level_nm"]).tolist() for e in both.effects}
    assert levels == {("knees",): [1.0, 0.0, 0.0], ("hips",): [0.0, 1.0, 0.0]}
    assert merged_models([knees, knees]) is knees
    per_run = RobotModel((CoulombFriction(level_nm=np.ones((3, 1))),))
    assert merged_models([per_run, knees]) is None


def test_a_number_for_each_joint_stands_beside_one_for_all() -> None:
    by_joint = RobotModel((TorqueGain(gain=np.linspace(0.9, 1.1, 12)[None]),))
    both = merged_models([by_joint, RobotModel((TorqueGain(gain=0.8),)), RobotModel()])
    assert both is not None
    gain = both.effects[0].values["gain"]
    np.testing.assert_allclose(gain, [np.linspace(0.9, 1.1, 12), np.full(12, 0.8), np.ones(12)])


def test_effects_keep_their_order() -> None:
    a, b, c = TorqueGain(gain=0.9), StribeckFriction(level_nm=1.0), TorqueOffset(offset_nm=1.0)
    models = [RobotModel(own) for own in ((a, c), (b, c), (c, a))]
    both = merged_models(models)
    assert both is not None
    assert len(both.effects) == 4
    for row, model in enumerate(models):
        acting = [e.name for e in both.effects if any(np.ravel(v)[row] != p.null for p, v in _numbers(e))]
        assert acting == [e.name for e in model.effects]


def _numbers(effect: Effect) -> list[tuple[Parameter, object]]:
    values = [(p, getattr(effect, p.name)) for p in effect.parameters()]
    return [(p, value) for p, value in values if np.ndim(value)]


def test_a_batch_has_few_effects_however_its_models_differ() -> None:
    """Joints do not keep effects apart, nor does the place among effects of other hooks."""
    late, gain = CommandDelay(delay_s=0.01), TorqueGain(joints=("hips",), gain=0.9)
    friction = [StribeckFriction(joints=(j,), level_nm=1.0) for j in ("fl_kn", "fr_kn")]
    both = merged_models([RobotModel((late, gain, *friction)), RobotModel((gain, friction[0], late)), RobotModel()])
    assert both is not None
    assert [e.name for e in both.effects] == ["torque_gain", "stribeck_friction", "command_delay"]
    level = np.zeros((3, 12))
    level[:2, facts.JOINT_NAMES.index("fl_kn")] = level[0, facts.JOINT_NAMES.index("fr_kn")] = 1.0
    np.testing.assert_array_equal(both.effects[1].values["level_nm"], level)


def test_effects_that_add_up_joints_stay_apart() -> None:
    knees, hips = (BusSag(joints=(j,), resistance_ohm=0.1, copper_w_per_nm2=0.1) for j in ("knees", "hips"))
    both = merged_models([RobotModel((knees,)), RobotModel((hips,)), RobotModel((knees, hips))])
    assert both is not None
    assert [e.joints for e in both.effects] == [("knees",), ("hips",)]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.label)
def test_beside_any_effect_a_run_without_it_moves_as_ever(case: Case) -> None:
    entry = LIBRARY[case.effect]
    model = RobotModel((entry.make(case.values, case.joints),))
    both = merged_models([RobotModel(), model])
    assert both is not None
    plants = [Plant(m.effects, n, PlantOptions()) for m, n in ((both, 2), (RobotModel(), 1))]
    for plant in plants:
        for k in range(12):
            plant.step(facts.DEFAULT_POSITION_RAD + 0.3 * np.sin(0.7 * k), 4)
    np.testing.assert_array_equal(plants[0].joint_position_rad[0], plants[1].joint_position_rad[0])
    np.testing.assert_array_equal(plants[0].reading.velocity_rad_s[0], plants[1].reading.velocity_rad_s[0])
