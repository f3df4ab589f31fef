"""Our words for what the readers of other programs' files raise."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spot_model.errors import BadInputError, SpotRlError


@contextmanager
def reading(path: Path, kind: str, package: str) -> Iterator[None]:
    """Read a file of some kind, with a package that may be missing.

    Raises:
        BadInputError: In place of what readers raise, of many types, on files that are damaged or made to harm.
        OSError: The file cannot be read.
    """
    try:
        yield
    except (SpotRlError, PermissionError):
        raise
    except ImportError as error:
        raise BadInputError(f"{path}: {kind} needs {error.name}: pip install {package}") from error
    except Exception as error:
        raise BadInputError(f"{path} cannot be read as {kind}: {str(error) or type(error).__name__}") from error
