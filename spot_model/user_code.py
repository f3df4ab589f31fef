"""Code of users, as ``module:name`` or as a plug-in: an error in it is told as theirs, with its line."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from spot_model.errors import BadInputError, SpotRlError

OWN_PACKAGES: Final = (
    *("spot_protos", "spot_model", "spot_log", "spot_runtime", "spot_tools", "fake_robot", "trainer"),
    *("diagnosis", "compare", "proof", "withheld", "spot_rl"),
)

_PLAIN: Final = (ImportError, AttributeError, ValueError, SyntaxError)
"""Errors whose text says enough."""


@contextmanager
def users_code(what: str, advice: str) -> Iterator[None]:
    """Words for whatever is raised while a user's code is imported or made.

    Args:
        what: Names it, as ``effect 'my_effects:Drag'``.
        advice: What to look at.

    Raises:
        BadInputError: Something was raised, even ``SystemExit`` of a script.
    """
    try:
        yield
    except SpotRlError:
        raise
    except (Exception, SystemExit) as error:
        told = str(getattr(error, "msg", error)) if isinstance(error, _PLAIN) else _named(error)
        raise BadInputError(f"{what} cannot be loaded: {told}{_at(error)}; {advice}") from error


def users_error(error: Exception, command: Path | None) -> BadInputError | None:
    """An error that a file of the user's raised, or cannot be read for; None where it is one of ours.

    Args:
        error: What ended a command.
        command: Source of the command's module, which is none of the user's, whoever brings it.
    """
    if isinstance(error, (SpotRlError, OSError)) or not (where := _at(error, command)):
        return None
    return BadInputError(f"{_named(error)}{where}; the file is not part of spot-rl: look there first")


def _named(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


def _at(error: BaseException, but: Path | None = None) -> str:
    """File and line of the last frame that is neither ours nor of an installed package; empty where there is none."""
    if isinstance(error, SyntaxError):
        return f" ({error.filename}, line {error.lineno})" if error.filename and _is_users(error.filename) else ""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) != but and _is_users(f.filename)]
    return f" ({frames[-1].filename}, line {frames[-1].lineno})" if frames else ""


def _is_users(file: str) -> bool:
    path = Path(file)
    installed = (sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib"))
    ours = (spec.submodule_search_locations for name in OWN_PACKAGES if (spec := find_spec(name)))
    folders = [*installed, *(folder for found in ours for folder in found or ())]
    return path.is_file() and not any(path.is_relative_to(folder) for folder in folders)
