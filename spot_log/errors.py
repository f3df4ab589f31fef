"""What can be wrong with a log, and what a damaged one is called; every message names the file and the next step."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from spot_model.errors import BadInputError, SpotRlError

ASIDE_SUFFIX: Final = ".damaged"
"""Of a leftover while it is recovered, and afterwards where it is damaged inside."""


class LogError(SpotRlError):
    """A log cannot be written."""


class LogExistsError(LogError):
    """A log's name is taken; logs are never overwritten."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"log {path} exists already; logs are never overwritten: choose another name")


class DiskSpaceError(LogError, OSError):
    """There is too little room for a log."""

    def __init__(self, directory: Path, free_bytes: int, needed_bytes: int) -> None:
        super().__init__(
            f"{directory} has {free_bytes / 1e6:.0f} MB free; a log needs at least {needed_bytes / 1e6:.0f} MB: "
            "make room, or log to another disk"
        )


class LogReadError(BadInputError):
    """A file cannot be read as a log of ours."""


class NotAnMcapError(LogReadError):
    """The file is not an MCAP file."""

    def __init__(self, path: Path, size_bytes: int) -> None:
        what = "is empty" if size_bytes == 0 else f"({size_bytes} bytes) is not an MCAP file"
        super().__init__(f"{path} {what}; expected a log written by spot-rl (*.mcap, or *.mcap.active after a crash)")


class MissingHeaderError(LogReadError):
    """An MCAP file has no header record of ours."""

    def __init__(self, path: Path, topics: list[str]) -> None:
        found = ", ".join(topics) if topics else "none"
        super().__init__(
            f"{path} has no /header record, so it is not a log written by spot-rl (topics found: {found}); "
            "'spot-rl log recover' repairs a damaged log, "
            "'spot-rl log import --suggest FILE' begins to turn other data into one"
        )


class ManyRunsError(LogReadError):
    """A file holds more than one run, as merging or appending makes it."""

    def __init__(self, path: Path, runs: list[str]) -> None:
        super().__init__(
            f"{path} holds {len(runs)} runs, and a log is one: {', '.join(f'run {run}' for run in runs)}; "
            "give the logs that it was made from, one at a time"
        )


class SchemaVersionError(LogReadError):
    """A log was written with other records than this program reads."""

    def __init__(self, path: Path, found: str, expected: str) -> None:
        super().__init__(f"{path} has records of schema {found!r}; this program reads {expected!r}")
