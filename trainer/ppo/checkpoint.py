"""Checkpoints: everything that an exact continuation, or an export, needs."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import torch
import yaml

from spot_model.errors import BadInputError
from spot_model.io.whole import whole_file
from spot_model.policy.observation import OBSERVATION_LAYOUT
from spot_model.robot import facts
from trainer.config.train_config import TrainConfig, config_from_data, config_yaml

if TYPE_CHECKING:
    from trainer.ppo.runner import PpoRunner

SCHEMA: Final = "spot-rl/checkpoint/1"
CONTRACT: Final = {
    "joint_names": list(facts.JOINT_NAMES),
    "observation_layout": [[name, size] for name, size in OBSERVATION_LAYOUT],
    "action_scale_rad": facts.ACTION_SCALE_RAD,
    "rate_hz": facts.POLICY_RATE_HZ,
    "kp_nm_per_rad": facts.POLICY_KP_NM_PER_RAD,
    "kd_nm_s_per_rad": facts.POLICY_KD_NM_S_PER_RAD,
    "default_position_rad": facts.DEFAULT_POSITION_RAD.tolist(),
}
"""What a checkpoint's networks were trained to see and to say, and what their word means to the servos."""


def save_checkpoint(path: Path, runner: PpoRunner, iterations_done: int) -> None:
    """Write networks, optimiser, environment and generators; an interrupted write leaves no half file."""
    content = {
        "schema": SCHEMA,
        "contract": CONTRACT,
        "config": config_yaml(runner.config),
        "iterations_done": iterations_done,
        "algorithm": runner.alg.save(),
        "environment": runner.env.snapshot(),
        "torch_generator": torch.get_rng_state(),
        "cuda_generator": torch.cuda.get_rng_state() if torch.cuda.is_available() else None,
    }
    packed = io.BytesIO()
    torch.save(content, packed)  # torch words a full disk as a defect of its own
    with whole_file(path, replace=True) as part:
        part.write_bytes(packed.getbuffer())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read and check a checkpoint.

    Raises:
        BadInputError: It cannot be read, is none of ours, or was made for another contract.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise BadInputError(f"checkpoint {path} cannot be read: {error.strerror}") from error
    except Exception as error:
        raise BadInputError(
            f"checkpoint {path} cannot be read ({type(error).__name__}); give a checkpoint_*.pt of 'spot-rl train'"
        ) from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise BadInputError(f"checkpoint {path} has the schema {found!r}; allowed: {SCHEMA!r}")
    for key, wanted in CONTRACT.items():
        # Where it says nothing, it is older than the key, and the value never changed.
        found = content["contract"].get(key, wanted)
        if found != wanted:
            raise BadInputError(
                f"checkpoint {path} was made for another contract: {key} = {found!r}; expected {wanted!r}"
            )
    return content


def save_networks(checkpoint: Path, out: Path) -> None:
    """Write a small checkpoint that only ``start_from`` and ``export`` can use: no optimiser, no environment."""
    content = read_checkpoint(checkpoint)
    keys = ("actor_state_dict", "critic_state_dict")
    small = {key: content[key] for key in ("schema", "contract", "config", "iterations_done")}
    packed = io.BytesIO()
    torch.save({**small, "algorithm": {key: content["algorithm"][key] for key in keys}}, packed)
    with whole_file(out) as part:
        part.write_bytes(packed.getbuffer())


def config_of(content: dict[str, Any], source: str) -> TrainConfig:
    """The config that a checkpoint was trained with."""
    return config_from_data(yaml.safe_load(content["config"]), source=source)


def find_checkpoint(run: Path) -> Path:
    """The newest checkpoint of a run's folder, or ``run`` itself if it is a checkpoint.

    Raises:
        BadInputError: There is none.
    """
    if run.is_file():
        return run
    checkpoints = sorted(run.glob("checkpoint_*.pt"))
    if not run.exists():
        raise BadInputError(f"run {run} does not exist; give a run folder that 'spot-rl train' made, or a checkpoint")
    if not checkpoints:
        raise BadInputError(f"run {run} has no checkpoint_*.pt; give a run folder that 'spot-rl train' made, or a file")
    return checkpoints[-1]


def load_networks(runner: PpoRunner, content: dict[str, Any], source: str) -> None:
    """Take over the networks only, for a run that starts from another one.

    Raises:
        BadInputError: The networks have other sizes.
    """
    if runner.config.ppo.start_std is not None:
        content["algorithm"]["actor_state_dict"]["distribution.std_param"].fill_(runner.config.ppo.start_std)
    try:
        runner.alg.load(content["algorithm"], {"actor": True, "critic": True}, strict=True)
    except RuntimeError as error:
        raise BadInputError(f"checkpoint {source}: its networks do not fit the config's ppo.hidden: {error}") from error


def restore(runner: PpoRunner, content: dict[str, Any]) -> None:
    """Put a runner into the state in which the checkpoint was written.

    Raises:
        BadInputError: The checkpoint holds networks alone, or robots whose state this version's do not have.
    """
    if "environment" not in content:
        raise BadInputError("this checkpoint holds networks alone; start a new run from it with --set start_from=FILE")
    runner.alg.load(content["algorithm"], None, strict=True)
    try:
        runner.env.restore(content["environment"])
    except (KeyError, ValueError) as error:
        raise BadInputError(
            f"this checkpoint's robots cannot go on: {error}. It is another version's; resume it with the revision in "
            "the run's run.json, or start a new run from its networks with --set start_from=FILE"
        ) from error
    runner.current_learning_iteration = int(content["iterations_done"])
    torch.set_rng_state(content["torch_generator"])
    if content["cuda_generator"] is not None and torch.cuda.is_available():
        torch.cuda.set_rng_state(content["cuda_generator"])
