"""The site builds strictly, asks nobody else for anything, and can be searched where it is opened from disk."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .blocks import REPOSITORY

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)]
    told = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    return folder


def test_its_pages_ask_nobody_else_and_swallow_no_list(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"?https?:", text), page.name
        prose = re.sub(r"<pre.*?</pre>", "", text, flags=re.DOTALL)
        swallowed = re.findall(r"\n\s*(?:\d+\.|-) (?:<strong>)?\w.*", prose)
        assert not swallowed, f"{page.name}: put an empty line before this item of a list: {swallowed}"
    for style in site.rglob("*.css"):
        assert not re.findall(r"url\(\"?https?:|@import", style.read_text(encoding="utf-8")), style.name


def test_links_of_the_other_pages_resolve() -> None:
    """mkdocs asks for those within ``docs/``, as strictly."""
    for page in REPOSITORY.glob("*.md"):
        links = re.findall(r"\]\((?!https?:|mailto:|#)([^)#\s]+)", page.read_text(encoding="utf-8"))
        assert not [link for link in links if not (REPOSITORY / link).exists()], page.name


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: the site is not searched in a browser")
@pytest.mark.parametrize("page", ["index.html", "reference/effects.html"])
def test_search_finds_pages_where_the_site_is_opened_from_disk(site: Path, tmp_path: Path, page: str) -> None:
    words = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    words += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    words += [f"--user-data-dir={tmp_path}", "--virtual-time-budget=10000", "--dump-dom"]
    told = subprocess.run([*words, f"{(site / page).as_uri()}?q=lease"], capture_output=True, text=True)
    found = re.findall(r'<a href="([^"?]*)[^"]*" class="md-search-result__link', told.stdout)
    assert (site / "operate.html").as_uri() in found, told.stderr
