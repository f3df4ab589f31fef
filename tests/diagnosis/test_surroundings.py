"""Surroundings are chosen on the other sequences, from few runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.closed_loop.environment import OWN, Surroundings, best_surroundings
from diagnosis.closed_loop.simulation import Rollout, rollouts_under
from spot_log.read.run import Run
from spot_model.effects.bodies import GroundCompliance
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from trainer.simulate.engine import Engine

from .planted import POLICY, scripts


@pytest.fixture(scope="module")
def policy() -> Policy:
    return load_policy(POLICY)


@pytest.fixture(scope="module")
def made(policy: Policy) -> list[Run]:
    return rollouts_under(policy).map([Rollout(RobotModel(), tuple(scripts(60)), 1)])[0]


class _Prepared(Engine[bytes, Rollout, list[Run]]):
    """An engine whose runs lie the further off, the further surroundings are from those of ``best`` for a sequence."""

    def __init__(self, runs: Sequence[Run], best: dict[str, Surroundings], columns: slice = slice(12, 24)) -> None:
        super().__init__(lambda _, rollout, __: list(self._made(rollout)), b"")
        self._runs, self._best = {r.header.command_sequence: r for r in runs}, best
        self.n_runs, self._columns = 0, columns

    def _made(self, rollout: Rollout) -> Iterator[Run]:
        for script, around in zip(rollout.scripts, _around(rollout), strict=True):
            self.n_runs += 1
            name = script.sequence.split(":")[1]
            run, best = self._runs[name], self._best[name]
            off = float(np.sum((_at(around) - _at(best)) ** 2))
            observation = run.ticks.observation.copy()
            observation[:, self._columns] += 0.05 * np.exp(0.5 * off)
            ticks = replace(run.ticks, observation=observation)
            yield replace(run, header=replace(run.header, command_sequence=script.sequence), ticks=ticks)


def _at(around: Surroundings) -> np.ndarray:
    """Coordinates in which the bounds are some units apart."""
    rate = 1.0 / around.odometry_time_s if around.odometry_time_s else 0.0
    logs = np.log([around.contact_time_constant_s, around.contact_damping_ratio, around.friction_scale])
    return np.array([*logs, rate / 20.0])


def _around(rollout: Rollout) -> list[Surroundings]:
    """What surrounds each run: the numbers of the effects that a batch of models has beside each other."""
    values = {
        f"{e.name}.{k}": np.broadcast_to(v, (len(rollout.scripts), 1))[:, 0]
        for e in rollout.model.effects
        for k, v in e.values.items()
    }
    none = np.zeros(len(rollout.scripts))
    return [
        Surroundings(OWN.contact_time_constant_s + t, OWN.contact_damping_ratio + d, f, o)
        for t, d, f, o in zip(
            values.get("ground_compliance.time_constant_s", none),
            values.get("ground_compliance.damping_ratio", none),
            values.get("ground_friction.scale", none + 1.0),
            values.get("leg_odometry.time_s", none),
            strict=True,
        )
    ]


def _best(made: list[Run], engine: _Prepared, policy: Policy) -> Mapping[str, Surroundings]:
    rng = np.random.default_rng(0)
    chosen = best_surroundings(RobotModel(), scripts(60), made, policy, engine, rng, lambda _: None)
    # Each of two sequences is judged by the other alone: nothing says how else one might have chosen.
    assert chosen.doubt == 0.0
    return chosen.by_sequence


def test_a_sequence_gets_what_suits_the_others(policy: Policy, made: list[Run]) -> None:
    hard, soft = Surroundings(0.0125, 0.8, 1.2, 0.1), Surroundings(0.027, 1.25, 0.7, 0.04)
    engine = _Prepared(made, {"a": hard, "b": soft})
    found = _best(made, engine, policy)
    for name, wanted in (("a", soft), ("b", hard)):
        np.testing.assert_allclose(_at(found[name]), _at(wanted), atol=0.25)


def test_a_body_that_moves_otherwise_tells_surroundings_too(policy: Policy, made: list[Run]) -> None:
    """The joints are the same in all of them."""
    wanted = Surroundings(0.0154, 0.8, 0.9, 0.06)
    engine = _Prepared(made, {"a": wanted, "b": wanted}, columns=slice(0, 3))
    np.testing.assert_allclose(_at(_best(made, engine, policy)["a"]), _at(wanted), atol=0.12)


def test_what_is_no_better_stays_the_simulators_own(policy: Policy, made: list[Run]) -> None:
    engine = _Prepared(made, {"a": OWN, "b": OWN})
    assert set(_best(made, engine, policy).values()) == {OWN}


def test_few_runs_are_asked_for(policy: Policy, made: list[Run]) -> None:
    near = Surroundings(0.0154, 1.0, 0.9, 0.05)
    engine = _Prepared(made, {"a": near, "b": near})
    _best(made, engine, policy)
    assert engine.n_runs <= 2 * 49


@pytest.mark.parametrize("own_s", [-0.015, -0.01, 0.0, 0.1])
def test_no_ground_is_harder_than_a_simulation_in_training_follows(own_s: float) -> None:
    """Two of training's physics steps of 5 ms; whatever ground the model has itself."""
    model = RobotModel((GroundCompliance(joints=("fl_kn",), time_constant_s=own_s, damping_ratio=-0.8),))
    for around in (Surroundings(0.007, 0.1), OWN, Surroundings(0.03)):
        total_s, total_ratio = np.zeros(4), np.zeros(4)
        for effect in around.around(model).effects:
            assert isinstance(effect, GroundCompliance)
            legs = effect.mask.reshape(4, 3).any(axis=1)
            total_s += legs * effect.time_constant_s
            total_ratio += legs * effect.damping_ratio
        assert (0.02 + total_s).min() >= 0.010 - 1e-12
        assert (1.0 + total_ratio).min() >= 0.2 - 1e-12


def test_a_ground_within_bounds_is_as_it_was_chosen() -> None:
    (ground,) = Surroundings(0.03, 0.8).around(RobotModel()).effects
    assert ground.values == pytest.approx({"time_constant_s": 0.01, "damping_ratio": -0.2})
