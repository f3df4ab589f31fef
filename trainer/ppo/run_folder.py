"""The folder of one training run."""

from __future__ import annotations

import json
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from spot_model.errors import BadInputError
from spot_model.io.whole import whole_folder
from spot_model.version import software_revision
from trainer.config.train_config import TrainConfig, config_yaml


def make_run_folder(folder: Path, config: TrainConfig, command: str, device: str) -> None:
    """Make ``folder`` and write ``config.yaml`` and ``run.json``.

    Raises:
        BadInputError: The folder exists and is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        raise BadInputError(f"run folder {folder} is not empty; choose another with --out, or --resume it")
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
