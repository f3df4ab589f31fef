from __future__ import annotations

import numpy as np
import pytest

from spot_log import Run
from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import CoulombFriction
from spot_model.policy.policy import Policy
from trainer.signals.policy_ticks import start_of
from trainer.simulate.rollout import (
    RolloutCase,
    RolloutOptions,
    in_whole_steps,
    roll_out,
)
from trainer.sysid.config import SysidConfig

SPACE = SysidConfig().space()


@pytest.fixture(scope="module")
def cases(logs: list[Run]) -> list[RolloutCase]:
    chosen = zip(("a", "b"), (logs[0], logs[3]), strict=True)
    return [RolloutCase(name, start_of(run), run.ticks.velocity_command[:40]) for name, run in chosen]


def features(policy: Policy, cases: list[RolloutCase], values: np.ndarray, threads: int = 1) -> np.ndarray:
    effects = SPACE.effects(values, len(cases))
    return roll_out(effects, len(values), cases, policy, RolloutOptions(n_threads=threads)).features


def test_a_candidate_does_not_feel_its_neighbours_nor_the_threads(policy: Policy, cases: list[RolloutCase]) -> None:
    other = SPACE.initial + np.array([0.5, 0.5, 10, -10, 1, -1, 3, -3])
    alone = features(policy, cases, SPACE.initial[None])
    together = features(policy, cases, np.stack([other, SPACE.initial, other]), threads=2)
    assert np.array_equal(alone[0], together[1])
    assert not np.array_equal(together[0], together[1])


def test_a_shorter_case_ends_in_nothing(policy: Policy, cases: list[RolloutCase]) -> None:
    short = RolloutCase(cases[1].sequence, cases[1].start, cases[1].velocity_command[:25])
    found = features(policy, [cases[0], short], SPACE.initial[None])
    assert np.isfinite(found[0, 0]).all()
    assert np.isfinite(found[0, 1, :25]).all()
    assert np.isnan(found[0, 1, 25:]).all()


def test_the_first_tick_shows_the_start(policy: Policy, cases: list[RolloutCase]) -> None:
    found = features(policy, cases, SPACE.initial[None])[0, 0, 0]
    assert found[:12] == pytest.approx(60.0 * cases[0].start.position_rad, rel=1e-5)
    assert found[12:24] == pytest.approx(1.5 * cases[0].start.velocity_rad_s, abs=1e-5)


def test_a_delay_is_brought_to_the_nearest_number_of_steps() -> None:
    def steps(delay_s: float) -> float:
        rounded = in_whole_steps(CommandDelay(delay_s=delay_s), 0.002)
        assert isinstance(rounded, CommandDelay)
        return round(rounded.delay_s / 0.002, 6)

    assert [steps(d) for d in (0.0, 0.0041, 0.0054, 0.006)] == [0, 2, 3, 3]
    friction = CoulombFriction(level_nm=0.1)
    assert in_whole_steps(friction, 0.002) is friction
