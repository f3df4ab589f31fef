"""Reading files that somebody names: never more than fits, whatever the name leads to."""

from __future__ import annotations

from pathlib import Path


class FileTooLargeError(ValueError):
    """A file, or whatever is behind its name, has more bytes than it may have."""


def read_at_most(path: Path, max_bytes: int) -> bytes:
    """A file's content; a device that never ends is read no further than any other file.

    Raises:
        FileTooLargeError: There is more.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise FileTooLargeError(f"it has more bytes than are allowed: at most {max_bytes}")
    return data
