"""The version of this software, as it is installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def software_version() -> str:
    """Such as ``0.1.0``; empty where it is not installed."""
    try:
        return version("spot-rl")
    except PackageNotFoundError:
        return ""
