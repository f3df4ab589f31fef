"""What a script gives, checked where it enters: paths as text or as a path, whole numbers, one name or several."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from spot_model.errors import BadInputError

AnyPath = str | os.PathLike[str]
T = TypeVar("T")


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


def whole(value: int, name: str, least: int = 0) -> int:
    """The whole number that was given, as a seed or a count.

    Raises:
        BadInputError: It is none, or below ``least``.
    """
    given: object = value
    if not isinstance(given, int) or isinstance(given, bool) or not least <= given < 2**63:
        raise BadInputError(f"{name} = {value!r}; allowed: a whole number, {least} or more")
    return given


def one_or_more(values: T | Iterable[T], name: str) -> list[T]:
    """One text or class, or several.

    Raises:
        BadInputError: It is something else.
    """
    if isinstance(values, (str, type)):
        return [values]
    if not isinstance(values, Iterable):
        raise BadInputError(f"{name} = {values!r:.60}; allowed: one, or a list of them")
    return list(values)
