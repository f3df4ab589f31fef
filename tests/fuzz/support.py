"""What every target needs: its form, a folder in memory, and words that count as an answer."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the fastest disk there is; a private folder is made in it


PREFIX = "spot-rl-fuzz-"


@dataclass(frozen=True)
class Target:
    """A parser, inputs from which to start, and how it is best fuzzed."""

    run: Callable[[bytes], object]
    seeds: Callable[[], list[bytes]]
    watched: tuple[str, ...] = field(default=("spot_model", "spot_runtime"))
    """Packages whose branches guide the fuzzer; what is not watched runs at full speed."""
    max_len: int = 512
    words: tuple[bytes, ...] = ()
    """The parser's own words; the fuzzer puts them in."""
    why_slow: str = ""
    """What bounds its rate, where it is slow."""


def folder() -> Path:
    """A folder in memory for parsers that want files; one a process.

    The fuzzer ends its process without a word to Python, so each clears away what those before it have left.
    """
    global _folder  # noqa: PLW0603
    if _folder is None:
        where = SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir())
        for left in where.glob(f"{PREFIX}*"):
            process = left.name.removeprefix(PREFIX).partition("-")[0]
            if process.isdecimal() and not Path("/proc", process).exists():
                shutil.rmtree(left, ignore_errors=True)
        _folder = tempfile.TemporaryDirectory(prefix=f"{PREFIX}{os.getpid()}-", dir=where)
    return Path(_folder.name)


_folder: tempfile.TemporaryDirectory[str] | None = None


def refusing(*kinds: type[BaseException]) -> contextlib.suppress:
    """Refusals in words are right answers."""
    from spot_model.errors import SpotRlError

    return contextlib.suppress(SpotRlError, *kinds)


def text_file(data: bytes, load: Callable[[Path], object]) -> None:
    """Give a parser of files a file."""
    path = folder() / "input.yaml"
    path.write_bytes(data)
    with refusing():
        load(path)
