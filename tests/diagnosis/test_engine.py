"""Rollouts are the same bits wherever they are computed, and what surrounds them acts."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.closed_loop.engine import LocalEngine, RayEngine, Rollout
from diagnosis.closed_loop.surroundings import Surroundings
from spot_log.read.run import Run
from spot_model.effects.drive.coulomb_friction import CoulombFriction
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from trainer.shared.ray_cluster import EngineError

from .standing_starts import POLICY, scripts

MODEL = RobotModel((CoulombFriction(joints=("knees",), level_nm=1.0),))


@pytest.fixture(scope="module")
def policy() -> Policy:
    return load_policy(POLICY)


def _rollouts(model: RobotModel = MODEL) -> list[Rollout]:
    return [Rollout(model, tuple(scripts(20)), 3), Rollout(RobotModel(), tuple(scripts(20))[:1], 4)]


def _same(one: list[list[Run]], other: list[list[Run]]) -> bool:
    pairs = zip((r for part in one for r in part), (r for part in other for r in part), strict=True)
    return all(np.array_equal(a.states.load_nm, b.states.load_nm) for a, b in pairs)


def test_a_rollout_depends_on_itself_alone(policy: Policy) -> None:
    told: list[float] = []
    both = LocalEngine(policy).simulate(_rollouts(), told.append)
    alone = [LocalEngine(policy).simulate([r], lambda _: None)[0] for r in _rollouts()]
    assert [len(part) for part in both] == [2, 1]
    assert _same(both, alone)
    assert told == sorted(told)
    assert 0.0 <= told[0] < told[-1] < 1.0


def test_ray_gives_the_same_bits(policy: Policy) -> None:
    pytest.importorskip("ray", reason="Ray is not installed: rollouts on a cluster are not tried")
    told: list[float] = []
    with RayEngine(POLICY.read_bytes()) as engine:
        spread = engine.simulate(_rollouts(), told.append)
    assert _same(spread, LocalEngine(policy).simulate(_rollouts(), lambda _: None))
    assert told[-1] == 1.0


def test_no_cluster_at_the_address_is_said() -> None:
    pytest.importorskip("ray", reason="Ray is not installed")
    with pytest.raises(EngineError, match=r"no cluster at nowhere.*leave --ray-address out"), RayEngine(b"", "nowhere"):
        pass


@pytest.mark.parametrize(
    "other", [{"contact_time_constant_s": 0.045}, {"contact_damping_ratio": 0.7}, {"odometry_time_s": 0.05}]
)
def test_surroundings_act_and_their_own_values_change_no_bit(policy: Policy, other: dict[str, float]) -> None:
    engine = LocalEngine(policy)
    plain = engine.simulate(_rollouts()[:1], lambda _: None)
    own = Surroundings().around(MODEL)
    assert _same(plain, engine.simulate(_rollouts(own)[:1], lambda _: None))
    assert not _same(plain, engine.simulate(_rollouts(Surroundings(**other).around(MODEL))[:1], lambda _: None))
