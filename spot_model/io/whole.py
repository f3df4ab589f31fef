"""Output that is there whole or not at all: an error, a full disk or Ctrl-C leaves nothing half-written behind."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spot_model.errors import DISK_FULL


@contextmanager
def whole(*paths: Path) -> Iterator[None]:
    """Take back the files and folders that the block makes, if it ends with an error; a full disk's error names them.

    Args:
        paths: What the block makes, with the folders above it; what was there before stays as it is.
    """
    made = [p for path in paths for p in (path, *path.parents) if not p.exists()]
    try:
        yield
    except BaseException as error:
        if isinstance(error, OSError) and error.errno in DISK_FULL and error.filename is None and paths:
            error.filename = str(paths[0])
        for path in sorted(set(made), key=lambda p: len(p.parts), reverse=True):
            if path in paths and path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            elif path in paths:
                path.unlink(missing_ok=True)
            elif path.is_dir() and not any(path.iterdir()):
                path.rmdir()
        raise


def check_writable(path: Path) -> None:
    """Refuse an output that could not be written, before the work for it begins.

    Raises:
        OSError: The nearest folder that exists, or the path itself, may not be written to.
    """
    nearest = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not os.access(nearest, os.W_OK):
        raise PermissionError(errno.EACCES, "may not be written to", str(nearest))
