"""Checkpoints: everything that an exact continuation, or an export, needs."""

from __future__ import annotations

import io
import json
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import torch
import yaml

from spot_model.errors import BadInputError
from spot_model.io.whole import whole_file, whole_folder
from spot_model.policy.observation import OBSERVATION_LAYOUT
from spot_model.robot import facts
from spot_model.version import software_revision
from trainer.config.train_config import TrainConfig, config_yaml, train_config_from_data


def check_run_folder(folder: Path) -> None:
    """Refuse a run folder that holds something. Raises BadInputError: it does."""
    if folder.exists() and any(folder.iterdir()):
        raise BadInputError(f"run folder {folder} is not empty; choose another with --out, or --resume it")


def make_run_folder(folder: Path, config: TrainConfig, command: str, device: str) -> None:
    """Make ``folder`` and write ``config.yaml`` and ``run.json``.

    Raises:
        BadInputError: The folder exists and is not empty.
    """
    check_run_folder(folder)
    record: dict[str, Any] = {
        "command": command,
        "device": device,
        "revision": software_revision(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in ("torch", "mujoco", "mujoco-warp", "rsl-rl-lib", "numpy")},
    }
    with whole_folder(folder) as part:
        (part / "config.yaml").write_text(config_yaml(config), encoding="utf-8")
        (part / "run.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def read_run_record(folder: Path) -> dict[str, Any]:
    """The run's ``run.json``; empty if there is none."""
    path = folder / "run.json"
    if not path.is_file():
        return {}
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record


def command_line() -> str:
    """The command that runs, without the path to its interpreter."""
    return " ".join(["spot-rl", *sys.argv[1:]])


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


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


def write_checkpoint(path: Path, content: dict[str, Any], *, replace: bool = False) -> None:
    """Write a checkpoint's content beside its schema and contract; an interrupted write leaves no half file."""
    packed = io.BytesIO()
    torch.save({"schema": SCHEMA, "contract": CONTRACT, **content}, packed)  # torch words a full disk as its own defect
    with whole_file(path, replace=replace) as part:
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


def config_of(content: dict[str, Any], source: str) -> TrainConfig:
    """The config that a checkpoint was trained with."""
    return train_config_from_data(yaml.safe_load(content["config"]), source=source)


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
