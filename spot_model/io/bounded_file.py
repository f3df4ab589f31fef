"""Bounded reading of files named by a user: never more than a limit, and never blocking on a pipe."""

from __future__ import annotations

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path


class FileTooLargeError(ValueError):
    """A file, or whatever is behind its name, has more bytes than it may have."""


def open_to_read(path: Path) -> BufferedReader:
    """A file, opened for reading; a pipe without a writer is refused, since opening it would wait for ever.

    Raises:
        OSError: It cannot be opened, is a pipe, or its name is none.
    """
    try:
        file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 - for the caller
    except ValueError as error:
        raise OSError(errno.EINVAL, str(error), str(path)) from error
    if stat.S_ISFIFO(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is a pipe and no file", str(path))
    return file


def read_at_most(path: Path, max_bytes: int) -> bytes:
    """A file's content; a device that never ends is read no further than any other file.

    Raises:
        FileTooLargeError: There is more.
        OSError: It cannot be read.
    """
    with open_to_read(path) as file:
        data = file.read(max_bytes + 1) or b""  # a terminal without input returns None
    if len(data) > max_bytes:
        raise FileTooLargeError(f"it has more bytes than are allowed: at most {max_bytes}")
    return data


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)
