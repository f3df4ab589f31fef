"""The version of this software, as it is installed, and the revision of its sources."""

from __future__ import annotations

import functools
import os
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from spot_model.process.child_process import without_secrets

REVISION_VARIABLE: Final = "SPOT_RL_REVISION"
UNKNOWN: Final = "unknown"
GIT_TIMEOUT_S: Final = 5.0


def software_version() -> str:
    """Version of this package, such as ``0.1.0``; empty where it is not installed."""
    try:
        return version("spot-rl")
    except PackageNotFoundError:
        return ""


def software_revision() -> str:
    """The sources' revision, with ``+changes`` if files differ from it; ``unknown`` outside a checkout.

    Where the sources were copied without their history, the environment variable SPOT_RL_REVISION says it.
    """
    return os.environ.get(REVISION_VARIABLE) or _checked_out(Path(__file__).parents[1])


@functools.cache
def _checked_out(folder: Path) -> str:
    """Of the checkout whose root this is; whatever other project a wheel was installed in does not count."""
    try:
        root, revision = _git("rev-parse", "--show-toplevel", "HEAD", folder=folder).splitlines()
        if not Path(root).samefile(folder):
            return UNKNOWN
        changes = _git("status", "--porcelain", "--untracked-files=no", folder=folder)
    except (OSError, ValueError, subprocess.SubprocessError):
        return UNKNOWN
    return revision + ("+changes" if changes else "")


def _git(*arguments: str, folder: Path) -> str:
    words = ["git", "--no-optional-locks", *arguments]
    environment = without_secrets(os.environ)
    done = subprocess.run(  # noqa: S603 - our own words
        words, cwd=folder, env=environment, capture_output=True, text=True, check=True, timeout=GIT_TIMEOUT_S
    )
    return done.stdout.strip()
