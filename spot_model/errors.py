"""The base class of every error that a user should read as one line, without a traceback."""

from __future__ import annotations

import errno
from typing import Final

DISK_FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the system's errors for a disk, a quota or a file that takes no more."""


class SpotRlError(Exception):
    """An error whose message is meant for the user.

    The message names the thing, its value, what is allowed and the next step. The command line prints it as one line
    and leaves with ``exit_code``; a subclass may set its own.
    """

    exit_code: int = 1


class BadInputError(SpotRlError):
    """Something that came from outside (file, message, flag, environment) is not valid."""

    exit_code: int = 2


class GpuMemoryError(SpotRlError):
    """The GPU has too little memory for what was asked."""

    exit_code: int = 75


def system_words(error: OSError) -> str:
    """What the system says, with the file first and the number left out."""
    told = f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error.strerror or error)
    if error.errno in DISK_FULL:
        return f"{told}; make room, or write elsewhere, and run the command again"
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM) and error.filename:
        return f"{told}; check its permissions, or name another path"
    if error.errno == errno.ENOTDIR and error.filename:
        return f"{told}; name a folder, or a path that is free"
    if error.errno == errno.EISDIR and error.filename:
        return f"{told}; name a file"
    if error.errno == errno.EEXIST and error.filename:
        return f"{told}; nothing is overwritten: choose another name"
    if error.errno == errno.ENOENT and error.filename:
        return f"{told}; check the path, or make its folder first"
    return told
