"""Text from outside, before a terminal or a page sees it."""

from __future__ import annotations

import unicodedata
from typing import Final

REPLACEMENT: Final = "\N{REPLACEMENT CHARACTER}"
_KEPT: Final = "\n\t"
_BAD: Final = frozenset({"Cc", "Cf", "Cs", "Co", "Zl", "Zp"})
"""Control, format (writing directions among them), half of a pair, private use, line and paragraph separators."""


def plain(text: str, *, keep: str = "") -> str:
    """The text without what a terminal obeys or a reader cannot see; each such character becomes a mark.

    Args:
        text: A robot's, a policy's or a log's.
        keep: Characters to leave, such as a line's end.
    """
    if text.isprintable():
        return text
    return "".join(c if c in keep or unicodedata.category(c) not in _BAD else REPLACEMENT for c in text)


def counted(n: int, word: str) -> str:
    """A number and its noun: 1 log, 2 logs."""
    return f"{n} {word}" if n == 1 else f"{n} {word}s"


def plain_lines(text: str) -> str:
    """Like :func:`plain`, but ends of lines and tabs stay as they are."""
    return plain(text, keep=_KEPT)
