"""The figures in the README's table stand on the pages of evidence."""

from __future__ import annotations

import re

from .blocks import REPOSITORY

UNITS = ("%", "ms", "µs", "s", "MB", "GB", "m/s", "Hz", "times", "robots", "policy steps", "faults")
FIGURE = re.compile(rf"(?<![\w.,`])\d[\d,]*(?:\.\d+)?(?= (?:{'|'.join(UNITS)})(?!\w))")


def test_the_readme_states_no_figure_of_its_own() -> None:
    pages = [*(REPOSITORY / "docs" / "evidence").glob("*.md"), REPOSITORY / "policies" / "README.md"]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    section = (
        (REPOSITORY / "README.md").read_text(encoding="utf-8").partition("## Six figures")[2].partition("\n## ")[0]
    )
    rows = [line.split("|")[2] for line in section.splitlines() if line.startswith("| ") and "?" in line]
    figures = {figure for row in rows for figure in FIGURE.findall(row)}
    assert len(figures) > 10
    assert not [n for n in figures if not re.search(rf"(?<![\d.,]){re.escape(n)}(?![\d]|[.,]\d)", text)]
