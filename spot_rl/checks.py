"""Checks of what a script gives. Each returns the value, or raises :class:`BadInputError` with the argument's name."""

from __future__ import annotations

import functools
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from spot_log.read.run import Run
from spot_model.errors import BadInputError, SpotRlError, system_words
from spot_model.io.whole import OutputExistsError

AnyPath = str | os.PathLike[str]
T = TypeVar("T")
P = ParamSpec("P")
OPTION = re.compile(r"(?<![\w-])--([a-z][a-z-]+)")
ARGUMENTS = {"add-effect": "add_effects", "resume": "resume=True"}
"""Options whose argument is not spelled alike."""
LONGEST_NAME = 255
"""Bytes that Linux' file systems take."""


def with_our_errors(function: Callable[P, T]) -> Callable[P, T]:
    """The same function, whose errors are :class:`SpotRlError` and name arguments, not the options of the commands."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except OSError as error:
            raise SpotRlError(system_words(error)) from error
        except SpotRlError as error:
            error.args = (in_python(str(error)),)
            raise

    return call


def in_python(message: str) -> str:
    """A message of the commands with arguments in the place of options; one that holds a command stays."""
    if "spot-rl " in message:
        return message
    return OPTION.sub(lambda option: ARGUMENTS.get(option[1], option[1].replace("-", "_")), message)


def wrong(name: str, value: object, allowed: str) -> BadInputError:
    """The error of a value that is not allowed."""
    told = repr(value)
    return BadInputError(f"{name} = {told if len(told) <= 60 else told[:59] + '…'}; allowed: {allowed}")


def to_path(value: AnyPath, name: str, allowed: str = "a path, as text or pathlib.Path") -> Path:
    """The path that was given; ``allowed`` says what could have been.

    Raises:
        BadInputError: It is neither text nor a path.
    """
    given: object = value
    told = os.fspath(given) if isinstance(given, (str, os.PathLike)) else None
    if (
        isinstance(told, str)
        and told
        and "\0" not in told
        and all(len(p) <= 255 for p in os.fsencode(told).split(b"/"))
    ):
        return Path(told)
    raise wrong(name, value, allowed)


def existing(value: AnyPath, name: str) -> Path:
    """The path of a file or folder that is there.

    Raises:
        BadInputError: It is no path, or there is nothing.
    """
    path = to_path(value, name)
    if not path.exists():
        raise BadInputError(f"{name} {path} does not exist (looked in {Path.cwd()}); give the path of a file or folder")
    return path


def a_file(value: AnyPath, name: str) -> Path:
    """The path of a file that is there.

    Raises:
        BadInputError: It is no path, there is nothing, or it is a folder.
    """
    path = existing(value, name)
    if path.is_dir():
        raise BadInputError(f"{name} {path} is a folder; give the path of a file")
    return path


def a_folder(value: AnyPath, name: str) -> Path:
    """The path of a folder that is there or can be made.

    Raises:
        BadInputError: It is no path, or a file is in its place.
    """
    path = to_path(value, name)
    for part in (path, *path.parents):
        if part.exists() and not part.is_dir():
            raise BadInputError(f"{name} {path}: {part} is a file; give the path of a folder")
    return path


def new_file(value: AnyPath, name: str) -> Path:
    """The path of a file that is not there yet.

    Raises:
        BadInputError: It is no path, or something is there.
    """
    path = to_path(value, name)
    if path.is_dir():
        raise BadInputError(f"{name} {path} is a folder; give the path of a file that is to be written")
    a_folder(path.parent, name)
    if path.exists():
        raise OutputExistsError(path)
    return path


def existing_all(values: AnyPath | Iterable[AnyPath], name: str) -> list[Path]:
    """One path or several, which must be there.

    Raises:
        BadInputError: There is none, one is no path, or one is not there.
    """
    given: list[AnyPath] = one_or_more(values, name)
    if not given:
        raise BadInputError(f"{name} is empty; give at least one file or folder")
    return [existing(value, name) for value in given]


def whole(value: int, name: str, least: int = 0, most: int = 2**63 - 1) -> int:
    """The whole number that was given, as a seed or a count.

    Raises:
        BadInputError: It is none, or not within ``least`` and ``most``.
    """
    given: object = value
    if isinstance(given, bool) or not isinstance(given, (int, np.integer)) or not least <= int(given) <= most:
        bounds = f"{least} or more" if most >= 2**63 - 1 else f"{least} to {most}"
        raise wrong(name, value, f"a whole number, {bounds}")
    return int(given)


def number(value: float, name: str, low: float, high: float, allowed: str) -> float:
    """The number that was given, above ``low`` and up to ``high``; ``allowed`` says so in words.

    Raises:
        BadInputError: It is none, or out of these bounds.
    """
    given: object = value
    if isinstance(given, bool) or not isinstance(given, (int, float, np.number)) or not low < float(given) <= high:
        raise wrong(name, value, allowed)
    return float(given)


def numbers(values: Sequence[float], name: str, allowed: str, most: float) -> tuple[float, float, float]:
    """Three finite numbers, each within ±``most``.

    Raises:
        BadInputError: They are something else.
    """
    try:
        given = [] if isinstance(values, (str, bytes)) else [float(v) for v in values]
    except (TypeError, ValueError):
        given = []
    if len(given) != 3 or not all(math.isfinite(v) and abs(v) <= most for v in given):
        raise wrong(name, values, allowed)
    return given[0], given[1], given[2]


def flag(value: bool, name: str) -> bool:
    """True or False.

    Raises:
        BadInputError: It is neither.
    """
    given: object = value
    if not isinstance(given, bool):
        raise wrong(name, value, "True or False")
    return given


def text(value: str, name: str, allowed: str = "a text in one line that is not empty") -> str:
    """The text that was given.

    Raises:
        BadInputError: It is none, or empty.
    """
    given: object = value
    if not isinstance(given, str) or not given.strip() or not given.isprintable():
        raise wrong(name, value, allowed)
    return given


def mapping(value: Mapping[str, Any], name: str, allowed: str) -> dict[str, Any]:
    """The mapping that was given, whose keys are texts.

    Raises:
        BadInputError: It is something else.
    """
    given: object = value
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise wrong(name, value, allowed)
    return dict(given)


def one_or_more(values: T | Iterable[T], name: str) -> list[T]:
    """One text, path or class, or several.

    Raises:
        BadInputError: It is something else.
    """
    if isinstance(values, (str, type, os.PathLike)):
        return [values]
    if not isinstance(values, Iterable) or isinstance(values, (bytes, Mapping)):
        raise wrong(name, values, "one, or a list of them")
    return list(values)


def a_run(value: Run, name: str = "run") -> Run:
    """The run that was given.

    Raises:
        BadInputError: It is none.
    """
    given: object = value
    if not isinstance(given, Run):
        raise BadInputError(f"{name}: {value!r:.60} is no run; read a log first: run = spot_rl.read_run(PATH)")
    return given
