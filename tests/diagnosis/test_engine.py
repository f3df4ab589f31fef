"""Rollouts are the same bits in one process and in two, and what surrounds them acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.closed_loop.environment import Surroundings
from diagnosis.closed_loop.simulation import Rollout, Rollouts, rollouts_under, run_all, simulate_all
from spot_log.read.run import Run
from spot_model.effects.commands import CommandJitter
from spot_model.effects.friction import CoulombFriction
from spot_model.effects.joint_sensors import SensorNoise
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from trainer.simulate.engine import Place, ignore

from .standing_starts import POLICY, scripts

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


def _many_runs(engine: Rollouts) -> list[Run]:
    """Runs of models with random effects, beside each other; some end before the others."""
    models = [
        RobotModel((CommandJitter(mean_s=0.002 * (i % 2)), SensorNoise(load_nm=0.5 * (i % 3)), *MODEL.effects[: i % 2]))
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
    model = RobotModel((CoulombFriction(joints=("knees",), level_nm=levels), SensorNoise(load_nm=1.0)))
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
    "other", [{"contact_time_constant_s": 0.045}, {"contact_damping_ratio": 0.7}, {"odometry_time_s": 0.05}]
)
def test_surroundings_act_and_their_own_values_change_no_bit(policy: Policy, other: dict[str, float]) -> None:
    engine = rollouts_under(policy)
    plain = engine.map(_rollouts()[:1])[0]
    own = Surroundings().around(MODEL)
    assert _same(plain, engine.map(_rollouts(own)[:1])[0])
    assert not _same(plain, engine.map(_rollouts(Surroundings(**other).around(MODEL))[:1])[0])
