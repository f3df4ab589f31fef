"""Pages that a person can read: short sentences, and short pages."""

from __future__ import annotations

from pathlib import Path

import pytest

from .blocks import DOCS, REPOSITORY
from .prose import long_sentences, prose_words, without_code, words_in

MOST_WORDS_A_SENTENCE = 30
MOST_WORDS_A_PAGE = 1200
TOP = [REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "SECURITY.md")]
ALL = [*TOP, *sorted(DOCS.rglob("*.md"))]
USER_PAGES = sorted(DOCS.glob("*.md"))
BEHIND = [*sorted((DOCS / "method").glob("*.md")), *sorted((DOCS / "evidence").glob("*.md"))]


def name_of(page: Path) -> str:
    return str(page.relative_to(REPOSITORY))


@pytest.mark.parametrize("page", ALL, ids=name_of)
def test_sentences_are_short(page: Path) -> None:
    found = long_sentences(page.read_text(encoding="utf-8"), MOST_WORDS_A_SENTENCE)
    assert not found, f"{name_of(page)}: more than {MOST_WORDS_A_SENTENCE} words in:\n" + "\n".join(found)


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_user_pages_are_short(page: Path) -> None:
    words = words_in(without_code(page.read_text(encoding="utf-8")))
    told = f"{name_of(page)} has {words} words; move what nobody needs first to docs/method or docs/evidence"
    assert words <= MOST_WORDS_A_PAGE, told


@pytest.mark.parametrize("page", BEHIND, ids=name_of)
def test_the_pages_behind_them_are_long_only_by_tables(page: Path) -> None:
    words = prose_words(page.read_text(encoding="utf-8"))
    assert words <= MOST_WORDS_A_PAGE, f"{name_of(page)} has {words} words beside its tables"


def test_a_long_sentence_is_found_and_only_that() -> None:
    words = "word " * 29
    page = f"# Title\n\nShort. A {words}end.\n\n- An item\n- {words}`a b c` last\n\n| {words} {words} |\n"
    assert long_sentences(page, 30) == [f"A {words}end.", f"{words}X last"]


def test_what_is_no_prose_is_not_counted() -> None:
    page = "<!-- a note -->\n```sh\nspot-rl run\n```\n\n[two words](a-page.md#part), `some code`.\n\n| in | table |\n"
    assert words_in(without_code(page)) == 5
    assert prose_words(page) == 3
