"""Output that is there whole or not at all: an error, a full disk or Ctrl-C leaves nothing half-written behind."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(*paths: Path) -> Iterator[None]:
    """Take back the files and folders that the block makes, if it ends with an error.

    Args:
        paths: What the block makes, with the folders above it; what was there before stays as it is.
    """
    made = [p for path in paths for p in (path, *path.parents) if not p.exists()]
    try:
        yield
    except BaseException:
        for path in sorted(set(made), key=lambda p: len(p.parts), reverse=True):
            if path in paths and path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            elif path in paths:
                path.unlink(missing_ok=True)
            elif path.is_dir() and not any(path.iterdir()):
                path.rmdir()
        raise
