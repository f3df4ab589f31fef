"""Output that is whole or not there at all: it is written beside its place and moves there when it is complete.

An error, a full disk, Ctrl-C or a second process that writes the same output leaves what was there as it was.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

from spot_model.errors import DISK_FULL, BadInputError

PART: Final = ".spot-rl-part-"
"""How the names of folders begin that hold unfinished output; a process that was killed may leave one."""


class OutputExistsError(BadInputError):
    """An output is there already."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} exists; nothing is overwritten: choose another name, or remove it")


def check_new(*paths: Path) -> None:
    """Refuse outputs that exist or could not be written, before the work for them begins.

    Raises:
        OutputExistsError: One of them exists.
        OSError: The nearest folder that exists may not be written to, or is a file.
    """
    for path in paths:
        if path.exists() or path.is_symlink():
            raise OutputExistsError(path)
        nearest = _nearest_that_exists(path)
        if not nearest.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, "is a file, not a folder", str(nearest))
        if not os.access(nearest, os.W_OK):
            raise PermissionError(errno.EACCES, "may not be written to", str(nearest))


@contextmanager
def whole_folder(folder: Path, *, replace: bool = False) -> Iterator[Path]:
    """Yield an empty folder to write to. When the block ends, its files move to the same places in ``folder``.

    Args:
        folder: Where the files go; made if need be. What it holds already stays.
        replace: Let a new file take the place of an old one.

    Raises:
        OutputExistsError: One of the files exists; none is written then.
        OSError: A file cannot be written; that of a full disk names it.
    """
    try:
        part = Path(mkdtemp(prefix=PART, dir=_nearest_that_exists(folder / "any")))
    except OSError as error:
        error.filename = str(folder)
        raise
    made: list[Path] = []
    try:
        yield part
        staged = {file: folder / file.relative_to(part) for file in sorted(part.rglob("*")) if not file.is_dir()}
        try:
            for file, place in staged.items():
                made += [p for p in (place.parent, *place.parent.parents) if not p.exists()]
                place.parent.mkdir(parents=True, exist_ok=True)
                _move(file, place, replace=replace)
        except BaseException:
            for file, place in staged.items():
                if not replace and _is_moved(file, place):
                    place.unlink()
            for parent in sorted(set(made), key=lambda p: len(p.parts), reverse=True):
                if parent.is_dir() and not any(parent.iterdir()):
                    parent.rmdir()
            raise
    except OSError as error:
        _name(error, part, folder)
        raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def whole_file(path: Path, *, replace: bool = False) -> Iterator[Path]:
    """Yield a path to write to; when the block ends, what was written there takes the name ``path``.

    Raises:
        OutputExistsError: ``path`` exists, and ``replace`` is not set.
        OSError: It cannot be written; that of a full disk names it.
    """
    try:
        with whole_folder(path.parent, replace=replace) as part:
            yield part / path.name
    except OSError as error:
        if error.errno in DISK_FULL:
            error.filename = str(path)
        raise


def write_new(path: Path, text: str) -> None:
    """Write a text file that must not exist; see :func:`whole_file`."""
    check_new(path)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def write_over(path: Path, text: str) -> None:
    """Write a text file, in the place of an older one if there is one; see :func:`whole_file`."""
    with whole_file(path.resolve(), replace=True) as part:
        part.write_text(text, encoding="utf-8")


def finished(folder: Path, pattern: str) -> list[Path]:
    """Files below a folder whose names fit, sorted, without unfinished output."""
    return [
        file
        for file in sorted(folder.rglob(pattern))
        if not any(part.startswith(PART) for part in file.relative_to(folder).parts)
    ]


def _nearest_that_exists(path: Path) -> Path:
    """The nearest folder above a path that exists."""
    return next(p for p in path.absolute().parents if p.exists())


def _move(file: Path, place: Path, *, replace: bool) -> None:
    if replace:
        file.replace(place)
        return
    try:
        place.hardlink_to(file)  # unlike a rename it never takes the place of another file
    except FileExistsError:
        raise OutputExistsError(place) from None
    except OSError:
        # A file system without hard links, such as a USB stick's.
        if place.exists():
            raise OutputExistsError(place) from None
        file.rename(place)


def _is_moved(file: Path, place: Path) -> bool:
    return place.exists() and (not file.exists() or place.samefile(file))


def _name(error: OSError, part: Path, folder: Path) -> None:
    """Have an error name the file that the user asked for."""
    if error.filename is None and error.errno in DISK_FULL:
        error.filename = str(folder)
    elif isinstance(error.filename, str) and Path(error.filename).is_relative_to(part):
        error.filename = str(folder / Path(error.filename).relative_to(part))
