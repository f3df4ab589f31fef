"""Paths that a script gives: text or a path, checked where they enter."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from spot_model.errors import BadInputError

AnyPath = str | os.PathLike[str]


def to_path(value: AnyPath, name: str) -> Path:
    """The path that was given.

    Raises:
        BadInputError: It is neither text nor a path.
    """
    given: object = value
    if isinstance(given, (str, os.PathLike)) and str(given):
        return Path(given)
    raise BadInputError(f"{name} = {value!r} is no path; allowed: text or a pathlib.Path")


def existing(value: AnyPath, name: str) -> Path:
    """The path that was given, which must be there.

    Raises:
        BadInputError: It is no path, or there is nothing.
    """
    path = to_path(value, name)
    if not path.exists():
        raise BadInputError(f"{name} {path} does not exist (looked in {Path.cwd()}); give the path of a file or folder")
    return path


def existing_all(values: AnyPath | Iterable[AnyPath], name: str) -> list[Path]:
    """One path or several, which must be there.

    Raises:
        BadInputError: There is none, one is no path, or one is not there.
    """
    given = [values] if isinstance(values, (str, os.PathLike)) else list(values)
    if not given:
        raise BadInputError(f"{name} is empty; give at least one file or folder")
    return [existing(value, name) for value in given]
