from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from trainer.config.train_config import (
    config_yaml,
    load_train_config,
    resolve_path,
    train_config_from_data,
)

MINIMAL = {"name": "t", "iterations": 1}


def test_defaults_are_the_released_hyper_parameters() -> None:
    ppo = train_config_from_data(MINIMAL, source="test").ppo
    assert (ppo.hidden, ppo.steps_per_iteration, ppo.epochs, ppo.mini_batches) == ((512, 256, 128), 24, 5, 4)
    assert (ppo.learning_rate, ppo.desired_kl, ppo.clip, ppo.entropy) == (1e-3, 0.01, 0.2, 0.0025)


def test_yaml_round_trip_keeps_every_field(tmp_path: Path) -> None:
    config = train_config_from_data(MINIMAL, source="test", overrides=("rewards.gait=3.5", "ppo.hidden=[8, 4]"))
    path = tmp_path / "c.yaml"
    path.write_text(config_yaml(config), encoding="utf-8")
    assert load_train_config(path) == config


def test_overrides_reach_nested_keys_with_and_without_task() -> None:
    config = train_config_from_data(
        MINIMAL, source="test", overrides=("rewards.linear_velocity=15", "task.noise.scale=0")
    )
    assert config.task.rewards.linear_velocity == 15.0
    assert config.task.noise.scale == 0.0


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("rewards.linear_velocty=15", ["linear_velocty", "did you mean 'linear_velocity'", "yaw_rate"]),
        ("rewads.gait=1", ["rewads", "allowed:", "ppo"]),
        ("late_rewards.weights={gate: 3}", ["no reward is called gate", "linear_velocity, yaw_rate"]),
        ("ppo.hidden.first=3", ["has no keys below it"]),
        ("ppo.entropy", ["no '='"]),
        ("ppo.entropy=-1", ["ppo.entropy = -1", "greater than or equal to 0"]),
        ("commands.v_x_m_s=[2, 1]", ["low 2.0 exceeds high 1.0"]),
        ("physics_rate_hz=130", ["multiple of the policy's 50 Hz"]),
    ],
)
def test_a_bad_override_says_what_is_wrong(override: str, words: list[str]) -> None:
    with pytest.raises(BadInputError) as caught:
        train_config_from_data(MINIMAL, source="test", overrides=(override,))
    for word in words:
        assert word in str(caught.value)


def test_a_misspelt_key_in_the_file_lists_the_allowed_ones() -> None:
    data = {**MINIMAL, "task": {"rewards": {"gate": 1.0}}}
    with pytest.raises(BadInputError, match=r"(?s)no reward is called gate; allowed: linear_velocity, yaw_rate"):
        train_config_from_data(data, source="config x.yaml")


def test_every_leaf_can_be_named_by_an_override() -> None:
    assert resolve_path("task.reward_shape.swing_time_s") == ("task", "reward_shape", "swing_time_s")
    assert resolve_path("schema") == ("schema",)


@pytest.mark.parametrize("name", ["walk", "fast", "baseline", "walk_cpu", "settle"])
def test_the_committed_configs_are_valid(name: str) -> None:
    config = load_train_config(Path(__file__).parents[2] / "policies" / f"{name}.yaml")
    assert config.name == name
