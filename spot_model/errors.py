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
