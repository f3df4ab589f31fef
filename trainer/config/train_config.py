"""The training config: one frozen tree, read from YAML, overridden key by key with ``--set key.path=value``."""

from __future__ import annotations

import copy
import difflib
from pathlib import Path
from typing import Any, Final, Literal

import yaml
from pydantic import BaseModel, Field, ValidationError
from pydantic.fields import FieldInfo

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.yaml_text import read_yaml
from trainer.config.task_config import TaskConfig


def apply_overrides(data: dict[str, Any], overrides: tuple[str, ...]) -> dict[str, Any]:
    """A copy of ``data`` with each override set; values are YAML, so lists and numbers work.

    A path may leave out ``task.`` in front of a task's key: ``rewards.gait=5`` means ``task.rewards.gait=5``.

    Raises:
        BadInputError: An override has no ``=``, no valid value, or names a key that does not exist.
    """
    result = copy.deepcopy(data)
    for override in overrides:
        path, separator, text = override.partition("=")
        if not separator:
            raise BadInputError(f"override {override!r} has no '='; allowed: key.path=value")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise BadInputError(f"override {override!r}: its value is no YAML: {error}") from error
        _set(result, resolve_path(path.strip()), value)
    return result


def resolve_path(path: str) -> tuple[str, ...]:
    """The keys that ``path`` names, from the root.

    Raises:
        BadInputError: There is no such key; the message lists those that are allowed.
    """
    parts = tuple(path.split("."))
    if parts[0] not in _fields(TrainConfig) and parts[0] in _fields(TaskConfig):
        parts = ("task", *parts)
    here: Any = TrainConfig
    for depth, key in enumerate(parts):
        if not (isinstance(here, type) and issubclass(here, BaseModel)):
            raise BadInputError(f"key {path!r}: {'.'.join(parts[:depth])} has no keys below it; set it as a whole")
        if ":" in path and here.model_config.get("extra") == "allow":
            return (*parts[:depth], ".".join(parts[depth:]))  # of the form module:function
        allowed = _fields(here)
        if key not in allowed:
            close = difflib.get_close_matches(key, allowed, n=1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            raise BadInputError(f"key {path!r}: {key!r} is unknown; {hint}allowed: {', '.join(allowed)}")
        here = allowed[key].annotation
    return parts


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a part of the config by the keys that a file has for them."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def _set(data: dict[str, Any], path: tuple[str, ...], value: Any) -> None:
    *parents, last = path
    for key in parents:
        data = data.setdefault(key, {})
        if not isinstance(data, dict):
            raise BadInputError(f"key {'.'.join(path)!r}: {key!r} holds {data!r}; allowed: a mapping of keys")
    data[last] = value


SCHEMA: Final = "spot-rl/train/1"


class PpoConfig(Settings):
    """PPO's hyper-parameters; the defaults are those released with the paper's task."""

    hidden: tuple[int, ...] = Field(default=(512, 256, 128), min_length=1)
    """Widths of the hidden layers."""
    initial_std: float = Field(default=1.0, gt=0.0)
    """Initial standard deviation of the actions."""
    start_std: float | None = Field(default=None, gt=0.0)
    """Standard deviation of a run with `start_from`; None keeps the checkpoint's (of a policy: 0.3)."""
    critic_first_iterations: int = Field(default=0, ge=0)
    """First iterations, in which only the critic learns: one that starts from a policy knows no values yet."""
    steps_per_iteration: int = Field(default=24, ge=1)
    """Policy steps of each robot per iteration."""
    learning_rate: float = Field(default=1.0e-3, gt=0.0)
    """Learning rate of Adam."""
    schedule: Literal["adaptive", "fixed"] = "adaptive"
    """`adaptive` adjusts the learning rate to `desired_kl`."""
    desired_kl: float = Field(default=0.01, gt=0.0)
    """Target of the KL divergence between old and new policy."""
    clip: float = Field(default=0.2, gt=0.0)
    """Clipping of the probability ratio."""
    entropy: float = Field(default=0.0025, ge=0.0)
    """Weight of the entropy bonus."""
    value_loss: float = Field(default=0.5, gt=0.0)
    """Weight of the value loss."""
    epochs: int = Field(default=5, ge=1)
    """Passes over each iteration's data."""
    mini_batches: int = Field(default=4, ge=1)
    """Batches per pass."""
    gamma: float = Field(default=0.99, gt=0.0, le=1.0)
    """Discount factor."""
    lam: float = Field(default=0.95, gt=0.0, le=1.0)
    """λ of generalised advantage estimation."""
    max_grad_norm: float = Field(default=1.0, gt=0.0)
    """Clipping of the gradient's norm."""
    clip_value_loss: bool = True
    """Whether updates keep values within ``clip`` of the old ones; learning is slow then if returns are large."""
    normalise_observations: bool = False
    """Whether observations are normalised by running mean and deviation; export folds this into the first layer."""
    mirror_loss: float = Field(default=0.0, ge=0.0)
    """Weight of the left–right symmetry loss; 0 switches it off."""
    mirror_from_iteration: int = Field(default=0, ge=0)
    """Iteration from which the symmetry loss acts; before there is a gait, it favours hopping."""
    settle_iterations: int = Field(default=0, ge=0)
    """Last iterations, over which the entropy weight falls to 0 and ``desired_kl`` to a fifth, because the exported
    policy acts without exploration noise."""
    mixed_precision: bool = False
    """Whether the networks learn in 16 bits (bfloat16); quicker on a GPU and on CPUs with AVX-512 BF16."""
    cuda_graphs: bool = True
    """Whether a GPU repeats rollouts and updates as recorded graphs, without the host; rewards must not look at values
    then."""


class TrainConfig(Settings):
    """A whole training run."""

    schema_name: Literal["spot-rl/train/1"] = Field(default=SCHEMA, alias="schema")
    name: str = Field(min_length=1, max_length=100)
    """Name of the run and of the exported policy."""
    seed: int = Field(default=0, ge=0)
    """Random seed."""
    model: str = "paper_identified"
    """Built-in model name, a model file, or a models file; its effects act in training."""
    n_envs: int = Field(default=4096, ge=1)
    """Robots that are simulated in parallel; per GPU with several."""
    iterations: int = Field(ge=1)
    """Iterations of PPO."""
    save_every: int = Field(default=100, ge=1)
    """Iterations between checkpoints."""
    logger: Literal["tensorboard", "wandb"] = "tensorboard"
    """Where metrics go, in addition to metrics.jsonl; ``wandb`` is rsl-rl's writer for Weights & Biases."""
    start_from: str = ""
    """Checkpoint, or ONNX policy of this project, whose networks this run starts from; empty to start from scratch."""
    task: TaskConfig = TaskConfig()
    ppo: PpoConfig = PpoConfig()


def train_config_from_data(data: Any, *, source: str, overrides: tuple[str, ...] = ()) -> TrainConfig:
    """Check plain data and overrides (``key.path=value``) and build the config.

    Raises:
        BadInputError: A key is unknown (the message lists the allowed ones) or a value is not allowed.
    """
    if not isinstance(data, dict):
        raise BadInputError(f"{source}: holds {type(data).__name__}; allowed: a mapping of keys")
    merged = apply_overrides(data, overrides)
    try:
        return TrainConfig.model_validate(merged)
    except ValidationError as error:
        raise BadInputError(f"{source}:\n{explain(error, TrainConfig)}") from error


def load_train_config(path: Path, overrides: tuple[str, ...] = ()) -> TrainConfig:
    """Read a config from YAML and apply overrides. Raises BadInputError: the file cannot be read, or is not valid."""
    return train_config_from_data(read_yaml(path, "config"), source=f"config {path}", overrides=overrides)


def config_yaml(config: TrainConfig) -> str:
    """The whole config, defaults included, as YAML."""
    return yaml.safe_dump(config.model_dump(by_alias=True, mode="json"), sort_keys=False, allow_unicode=True)
