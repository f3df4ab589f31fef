"""No figure stands alone: each part of the evidence names its command, and the README's figures stand there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from proof.bench_all import read_claims

from .blocks import REPOSITORY

EVIDENCE = sorted((REPOSITORY / "docs" / "evidence").glob("*.md"))
BENCHMARKS = REPOSITORY / "docs" / "benchmarks.md"
PAGES = (*EVIDENCE, REPOSITORY / "policies" / "README.md")
COMMAND = re.compile(r"`{1,3}(?:sh\n)?[^`]*?\b(?:spot-rl \w+|python \S+\.py|make \w+|bash benchmarks/|torchrun )")
UNITS = ("%", "ms", "µs", "s", "MB", "GB", "m/s", "Hz", "times", "robots", "policy steps", "faults")
FIGURE = re.compile(rf"(?<![\w.,`])\d[\d,]*(?:\.\d+)?(?= (?:{'|'.join(UNITS)})(?!\w))")
PART = re.compile(r"^(?=##+ |\*\*[A-Z])", re.MULTILINE)


def parts_of(page: str) -> dict[str, str]:
    """Text by its heading, or by the bold words with which it begins."""
    return {part.split("\n")[0][:60]: part for part in PART.split(page) if part.strip()}


def without_command(page: str) -> list[str]:
    """Parts with a table that name no command."""
    return [head for head, part in parts_of(page).items() if "\n|---" in part and not COMMAND.search(part)]


def rows_of_readme(text: str) -> list[str]:
    """Answers of the README's table of figures."""
    section = text.partition("## Six figures")[2].partition("\n## ")[0]
    return [line.split("|")[2] for line in section.splitlines() if line.startswith("| ") and "?" in line]


def unknown_figures(row: str, pages: str) -> list[str]:
    """Numbers with a unit that stand on none of the pages."""
    found = {match.group() for match in FIGURE.finditer(row)}
    return sorted(n for n in found if not re.search(rf"(?<![\d.,]){re.escape(n)}(?![\d]|[.,]\d)", pages))


@pytest.mark.parametrize("page", [BENCHMARKS, *EVIDENCE], ids=lambda page: page.stem)
def test_every_table_of_figures_names_its_command(page: Path) -> None:
    assert not without_command(page.read_text(encoding="utf-8"))


def test_a_table_without_a_command_is_found() -> None:
    page = "## Loop\n\n| a | b |\n|---|---|\n| 1 | 2 |\n\n## Log\n\n`spot-rl log info`\n\n| a |\n|---|\n| 1 |\n"
    assert without_command(page) == ["## Loop"]


def test_the_readme_states_no_figure_of_its_own() -> None:
    rows = rows_of_readme((REPOSITORY / "README.md").read_text(encoding="utf-8"))
    pages = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert len(rows) == 6
    assert sum(len(FIGURE.findall(row)) for row in rows) > 10
    assert {row[:40]: unknown_figures(row, pages) for row in rows if unknown_figures(row, pages)} == {}


@pytest.mark.parametrize(("row", "unknown"), [("holds 5.32 m/s", []), ("holds 5.33 m/s, 82 %", ["5.33"])])
def test_a_figure_of_the_readme_that_no_page_has_is_found(row: str, unknown: list[str]) -> None:
    assert unknown_figures(row, "| held | 5.32 |\n82 % in the median") == unknown


def test_every_script_is_of_a_claim_or_named() -> None:
    scripts = sorted((REPOSITORY / "benchmarks").rglob("*.py"))
    names = {script: script.relative_to(REPOSITORY / "benchmarks").as_posix() for script in scripts}
    told = "\n".join(page.read_text(encoding="utf-8") for page in REPOSITORY.rglob("*.md") if ".venv" not in page.parts)
    claimed = {claim.script.split()[0] for claim in read_claims(REPOSITORY / "benchmarks").values()}
    texts = {script: script.read_text(encoding="utf-8") for script in scripts}
    imported = {s for s in scripts for other, text in texts.items() if other != s and f"from {s.stem} import" in text}
    run = {s for s in scripts for other, text in texts.items() if other != s and f'"{s.name}"' in text}
    alone = [n for s, n in names.items() if n not in claimed and n not in told and s not in imported | run]
    assert not alone, f"nothing names {', '.join(alone)}: name it on a page, or delete it"
    assert claimed - {"spot-rl"} <= set(names.values())
