"""A reward of one's own: one file, named in the config."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch
from pydantic import ValidationError

from spot_model.errors import BadInputError
from trainer.config.task_config import LateRewards, RewardShape, RewardWeights, TaskConfig
from trainer.config.train_config import apply_overrides
from trainer.task.rewards import TERMS, reward_term

OWN = '''
import torch


def low_body(moment, shape):
    """Tall robots are paid."""
    return torch.full((2,), 3.0)


number = 4
'''


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "my_rewards.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "my_rewards", raising=False)
    return "my_rewards"


def test_it_is_found_by_module_and_function(module: str) -> None:
    assert reward_term("my_rewards:low_body")(None, RewardShape()).tolist() == [3.0, 3.0]
    assert reward_term("gait") is TERMS["gait"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("my_rewards:number", "is 4; allowed: a function"),
        ("my_rewards:nothing", "cannot be loaded"),
        ("no_such_module:term", "cannot be loaded"),
        ("gati", "is unknown; allowed: action_smoothness"),
    ],
)
def test_what_is_no_reward_is_refused_in_words(module: str, name: str, text: str) -> None:
    with pytest.raises(BadInputError, match=text):
        reward_term(name)


def test_a_config_weighs_it_beside_ours(module: str) -> None:
    weights = RewardWeights.model_validate({"gait": 2.0, "my_rewards:low_body": 0.5})
    assert weights.by_name()["my_rewards:low_body"] == 0.5
    assert weights.by_name()["gait"] == 2.0
    late = LateRewards(weights={"my_rewards:low_body": 1.0})
    assert TaskConfig(rewards=weights, late_rewards=late).rewards.by_name() == weights.by_name()


def test_a_misspelt_name_is_refused_when_the_config_is_read() -> None:
    with pytest.raises(ValidationError, match=r"no reward is called gati; allowed: linear_velocity.*module:function"):
        RewardWeights.model_validate({"gati": 1.0})
    with pytest.raises(ValidationError, match="no reward is called gati"):
        LateRewards(weights={"gati": 1.0})


def test_it_can_be_set_on_the_command_line() -> None:
    data = apply_overrides({}, ("rewards.a.package.rewards:low_body=0.5",))
    assert data == {"task": {"rewards": {"a.package.rewards:low_body": 0.5}}}
    with pytest.raises(BadInputError, match="did you mean 'gait'"):
        apply_overrides({}, ("rewards.gati=1",))


def test_a_task_pays_it(module: str) -> None:
    from trainer.config.train_config import train_config_from_data
    from trainer.task.task import make_task

    plain = {"name": "own", "iterations": 1, "n_envs": 2, "seed": 1}
    with_own = {**plain, "task": {"rewards": {"my_rewards:low_body": 10.0}}}
    rewards = []
    for data in (plain, with_own):
        task = make_task(train_config_from_data(data, source="test"), "cpu", seed=0, n_threads=1)
        task.start()
        rewards.append(task.step(torch.zeros(2, 12)).reward)
    # 3 a period of 0.02 s, times its weight.
    torch.testing.assert_close(rewards[1] - rewards[0], torch.full((2,), 0.6))
