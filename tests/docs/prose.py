"""The prose of a page: its sentences, and its words, without code."""

from __future__ import annotations

import re
from collections.abc import Iterator

_CODE = re.compile(r"^( *)```.*?^\1```", re.DOTALL | re.MULTILINE)
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)\s]*(?: \"[^\"]*\")?\)")
_SPAN = re.compile(r"``[^`]+``|`[^`]+`")
_ITEM = re.compile(r"\s*(?:[-*+] |\d+\. |#+ |> )")
_END = re.compile(r"""(?<=[.!?])["')*_]*\s+(?=["'(*_\[]*[A-Z0-9]|["'])""")
_WORD = re.compile(r"[^\W_]")


def without_code(page: str) -> str:
    """The page less its code blocks and comments; a link is its text, a span of code one word."""
    text = _COMMENT.sub("", _CODE.sub("", page))
    return _SPAN.sub("X", _LINK.sub(r"\1", text))


def words_in(text: str) -> int:
    """Words, which hold a letter or a digit each."""
    return sum(1 for word in text.split() if _WORD.search(word))


def blocks_in(page: str) -> Iterator[str]:
    """Headings, paragraphs and items of lists, each on one line; tables are left out."""
    block: list[str] = []
    for line in [*without_code(page).splitlines(), ""]:
        is_item = _ITEM.match(line)
        is_own = not line.strip() or line.lstrip().startswith(("|", "<"))
        if block and (is_item or is_own or block[0].lstrip().startswith("#")):
            yield " ".join(" ".join(block).split())
            block = []
        if not is_own:
            block.append(line[is_item.end() :] if is_item else line)


def prose_words(page: str) -> int:
    """Words outside of tables."""
    return sum(map(words_in, blocks_in(page)))


def sentences_in(block: str) -> list[str]:
    """A block's sentences."""
    return [sentence for sentence in _END.split(block) if sentence]


def long_sentences(page: str, most: int) -> list[str]:
    """Sentences with more words than are allowed."""
    return [s for block in blocks_in(page) for s in sentences_in(block) if words_in(s) > most]
