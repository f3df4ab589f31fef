"""The fenced blocks of the documentation, and the commands in them and in its sentences."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
PAGES = [
    *(REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md")),
    *(page for folder in ("", "method", "evidence") for page in sorted((DOCS / folder).glob("*.md"))),
]
_FENCE = re.compile(r"(?:<!-- doc-test: (?P<order>[^\n]*) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)```", re.DOTALL)
_SPAN = re.compile(r"`([^`\n]+(?:\n[^`\n]+)?)`")


PROGRAMS = ("spot-rl", "python", "make", "pip", "torchrun", "bash", "sudo", "ssh", "systemctl", "journalctl")


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    page: Path
    language: str
    text: str
    order: str
    """``run`` (as one script), ``play`` (line by line, made short), ``session``, ``file NAME``, ``python`` (a program),
    ``gpu`` (refused where there is none), or nothing: then its commands are read by their parsers alone."""

    @property
    def lines(self) -> list[str]:
        """The block's command lines as they stand; continued lines are one."""
        joined = self.text.replace("\\\n", " ")
        return [line for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")]

    @property
    def commands(self) -> list[list[str]]:
        """The block's command lines, each as words; continued lines are one."""
        lines = self.lines
        if self.language != "sh":
            lines = [line for line in lines if line.startswith(("spot-rl ", "torchrun "))]
        # Brackets say what may be left out, an ellipsis what is repeated.
        lines = [re.sub(r"[\[\]]|\.\.\.", "", line) for line in lines]
        return [shlex.split(line, comments=True) for line in lines]


def blocks_of(page: Path) -> Iterator[Block]:
    """All blocks of a page."""
    for match in _FENCE.finditer(page.read_text(encoding="utf-8")):
        yield Block(page, match["language"], match["text"], match["order"] or "")


def all_blocks() -> list[Block]:
    """All blocks of all pages."""
    return [block for page in PAGES for block in blocks_of(page)]


def spans_of(page: Path) -> list[list[str]]:
    """The commands that stand in a page's sentences and tables, each as words."""
    spans = _SPAN.findall(_FENCE.sub("", page.read_text(encoding="utf-8")))
    return [shlex.split(span) for span in spans if span.split()[0] in PROGRAMS and span not in PROGRAMS]
