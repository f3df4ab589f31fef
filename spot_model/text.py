"""Text from outside, before a terminal or a page sees it."""

from __future__ import annotations

import re
import unicodedata
from typing import Final

REPLACEMENT: Final = "\N{REPLACEMENT CHARACTER}"
_UNIT: Final = re.compile(r"(_(per|cycles|nm2?|n|kg|m2?|s2?|rad|ohm|w|v|k))+$")
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


def parameter_words(name: str) -> str:
    """A parameter's name as words, without the unit at its end: that stands beside the value."""
    return _UNIT.sub("", name).replace("_", " ")
