"""The policies and training configs that come with the package, found by name from any folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from spot_model.errors import BadInputError

FOLDER: Final = Path(__file__).parent
WALK: Final = Path("walk")
"""The policy of commands that need any that walks."""


class NoPolicyError(BadInputError):
    """There is no such policy."""

    exit_code = 3


def built_in_files(suffix: str) -> dict[str, Path]:
    """The files of a kind by name, such as ``walk``."""
    return {path.stem: path for path in sorted(FOLDER.rglob(f"*{suffix}")) if not path.stem.endswith(".card")}


def policy_file(name_or_path: str | os.PathLike[str]) -> Path:
    """A built-in policy by name, or the path that was given.

    Raises:
        NoPolicyError: It is neither a built-in name nor a path of something that exists.
    """
    return _find(name_or_path, ".onnx", "policy", "the path of an ONNX file")


def policy_or_run(name_or_path: str | os.PathLike[str]) -> Path:
    """Like :func:`policy_file`, where a training's folder or checkpoint will do as well.

    Raises:
        NoPolicyError: It is neither a built-in name nor a path of something that exists.
    """
    return _find(name_or_path, ".onnx", "policy or run", "the path of an ONNX file, a run's folder or checkpoint")


def policy_or_log(name_or_path: str | os.PathLike[str]) -> Path:
    """Like :func:`policy_file`, where a training's folder or a log will do as well.

    Raises:
        NoPolicyError: It is neither a built-in name nor a path of something that exists.
    """
    return _find(name_or_path, ".onnx", "policy or log", "the path of an ONNX file, a run's folder or a log (*.mcap)")


def config_file(name_or_path: str | os.PathLike[str]) -> Path:
    """A built-in training config by name, or the path that was given.

    Raises:
        BadInputError: It is neither a built-in name nor a path of something that exists.
    """
    return _find(name_or_path, ".yaml", "config", "the path of a YAML file")


def _find(name_or_path: str | os.PathLike[str], suffix: str, kind: str, allowed: str) -> Path:
    text, built_in = os.fspath(name_or_path), built_in_files(suffix)
    if text in built_in:
        return built_in[text]
    if not text or not Path(text).exists():
        error = BadInputError if suffix == ".yaml" else NoPolicyError
        raise error(
            f"{kind} {text!r} does not exist (looked in {Path.cwd()}); allowed: {allowed}, or a built-in name: "
            f"{', '.join(built_in)}"
        )
    return Path(text)
