"""The folder of one training run."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from spot_model.errors import BadInputError
from trainer.config.train_config import TrainConfig, config_yaml

REVISION_VARIABLE: Final = "SPOT_RL_REVISION"


def make_run_folder(folder: Path, config: TrainConfig, command: str, device: str) -> None:
    """Make ``folder`` and write ``config.yaml`` and ``run.json``.

    Raises:
        BadInputError: The folder exists and is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        raise BadInputError(f"run folder {folder} is not empty; choose another with --out, or --resume it")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.yaml").write_text(config_yaml(config), encoding="utf-8")
    record: dict[str, Any] = {
        "command": command,
        "device": device,
        "revision": git_revision(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in ("torch", "mujoco", "mujoco-warp", "rsl-rl-lib", "numpy")},
    }
    (folder / "run.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def read_run_record(folder: Path) -> dict[str, Any]:
    """The run's ``run.json``; empty if there is none."""
    path = folder / "run.json"
    if not path.is_file():
        return {}
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record


def git_revision() -> str:
    """The source's revision, with ``+changes`` if files differ from it; ``unknown`` outside a checkout.

    Where the source was copied without its history, the environment variable SPOT_RL_REVISION says it.
    """
    if REVISION_VARIABLE in os.environ:
        return os.environ[REVISION_VARIABLE]
    here = Path(__file__).parent
    try:
        revision = _git("rev-parse", "HEAD", cwd=here)
        changes = _git("status", "--porcelain", "--untracked-files=no", cwd=here)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return revision + ("+changes" if changes else "")


def command_line() -> str:
    """The command that runs, without the path to its interpreter."""
    return " ".join(["spot-rl", *sys.argv[1:]])


def _git(*arguments: str, cwd: Path) -> str:
    done = subprocess.run(["git", *arguments], cwd=cwd, capture_output=True, text=True, check=True)  # noqa: S603, S607
    return done.stdout.strip()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
