"""Rollouts are the same bits wherever they are computed, and the ground under them acts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from typing_extensions import Self

from diagnosis.engine import LocalEngine, RayEngine, Rollout
from diagnosis.ground import OWN_S, TIME_CONSTANTS_S, best_ground
from diagnosis.measure import shrink_of
from diagnosis.shrink import features_by_sequence
from spot_model.effects.coulomb_friction import CoulombFriction
from spot_model.effects.payload_mass import PayloadMass
from spot_model.model_file import RobotModel
from spot_model.policy import Policy, load_policy
from spot_runtime.log.run import Run
from trainer.ray_cluster import EngineError

from .report_case import POLICY, scripts

MODEL = RobotModel((CoulombFriction(joints=("knees",), level_nm=1.0),))


@pytest.fixture(scope="module")
def policy() -> Policy:
    return load_policy(POLICY)


def _rollouts(ground: tuple[float, ...] | None = None) -> list[Rollout]:
    return [Rollout(MODEL, tuple(scripts(20)), 3, ground), Rollout(RobotModel(), tuple(scripts(20))[:1], 4)]


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


def test_the_ground_acts_and_its_own_value_changes_no_bit(policy: Policy) -> None:
    engine = LocalEngine(policy)
    plain = engine.simulate(_rollouts()[:1], lambda _: None)
    assert _same(plain, engine.simulate(_rollouts((OWN_S, OWN_S))[:1], lambda _: None))
    assert not _same(plain, engine.simulate(_rollouts((0.045, OWN_S))[:1], lambda _: None))


class _Prepared:
    """An engine whose runs on ground k of sequence s are those of ``best[s]``, or else shifted."""

    def __init__(self, runs: list[Run], best: dict[str, float]) -> None:
        self._runs, self._best = {r.header.command_sequence: r for r in runs}, best

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def simulate(self, rollouts: list[Rollout], tell: object) -> list[list[Run]]:
        return [list(self._made(r)) for r in rollouts]

    def _made(self, rollout: Rollout) -> Iterator[Run]:
        for script, ground in zip(rollout.scripts, rollout.contact_time_constant_s or (), strict=True):
            name = script.sequence.split(":")[1]
            run = self._runs[name]
            off = 0.2 * (TIME_CONSTANTS_S.index(ground) - TIME_CONSTANTS_S.index(self._best[name]))
            observation = run.ticks.observation.copy()
            observation[:, 12:24] += off
            ticks = replace(run.ticks, observation=observation)
            yield replace(run, header=replace(run.header, command_sequence=script.sequence), ticks=ticks)


def test_a_sequence_gets_the_ground_that_suits_the_others(policy: Policy) -> None:
    made = LocalEngine(policy).simulate([Rollout(RobotModel(), tuple(scripts(60)), 1)], lambda _: None)[0]
    real = features_by_sequence(made, policy)
    best = {"a": 0.008, "b": 0.045}
    engine = _Prepared(made, best)
    found = best_ground(RobotModel(), scripts(60), real, policy, engine, np.random.default_rng(0), lambda _: None)
    assert found == {"a": 0.045, "b": 0.008}


def test_a_model_that_is_the_truth_shrinks_the_gap_to_its_floor(policy: Policy) -> None:
    truth = RobotModel((PayloadMass(mass_kg=9.0),))
    many = tuple(replace(s, repeat=k) for k in range(3) for s in scripts(100))
    real = LocalEngine(policy).simulate([Rollout(truth, many, 1)], lambda _: None)[0]
    right = shrink_of(real, RobotModel(), truth, policy, np.random.default_rng(0))
    wrong = shrink_of(real, RobotModel(), RobotModel((PayloadMass(mass_kg=-2.0),)), policy, np.random.default_rng(0))
    assert right is not None
    assert wrong is not None
    assert right.s is not None
    assert right.d0 > 1.5 * right.floor
    assert right.s > 0.8
    assert wrong.s is not None
    assert wrong.s < 0.3
