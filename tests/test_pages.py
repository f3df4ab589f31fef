"""Every kind of page in a browser: on a wide and on a narrow screen, and printed."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser import CHROMIUM, Page
from tests.page_cases import PAGES

FAULTS = r"""
(() => {
  const bad = [], wide = innerWidth;
  if (document.scrollingElement.scrollWidth > wide) bad.push('the page is wider than the window');
  for (const e of document.querySelectorAll('main *:not(svg *)')) {
    const box = e.getBoundingClientRect(), name = `${e.tagName} ${e.textContent.slice(0, 40)}`;
    if (!box.width || e.closest('details:not([open]) > :not(summary)')) continue;
    if (box.right > wide + 1 || box.left < -1) bad.push(`${name} is outside of the window`);
    if (getComputedStyle(e).overflowX !== 'visible' && e.tagName !== 'svg' && e.scrollWidth > e.clientWidth + 1 &&
        e.tagName !== 'PRE') bad.push(`${name} is cut`);
  }
  for (const svg of document.querySelectorAll('main svg:not(svg svg)')) {
    const frame = svg.getBoundingClientRect(), view = svg.viewBox.baseVal, label = svg.getAttribute('aria-label');
    if (!frame.width) continue;
    for (const t of svg.querySelectorAll('text')) {
      const p = t.getBoundingClientRect();
      if (!p.width) continue;
      if (p.left < frame.left - 2 || p.right > frame.right + 2 || p.bottom > frame.bottom + 2)
        bad.push(`${label}: ${t.textContent} is cut`);
      const size = parseFloat(getComputedStyle(t).fontSize) * (view && view.width ? frame.width / view.width : 1);
      if (size < 8) bad.push(`${label}: ${t.textContent} is ${size.toFixed(1)} px high`);
    }
  }
  for (const mark of document.querySelectorAll('.legend i')) {
    const section = mark.closest('section'), colour = mark.getAttribute('style').split(':')[1];
    const drawn = [...section.querySelectorAll('svg [style], .bars [style]')]
      .some(e => e.getAttribute('style').includes(colour));
    if (!drawn) bad.push(`the legend explains ${mark.parentElement.textContent}, which is not drawn`);
  }
  return [...new Set(bad)];
})()
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with Page("about:blank", tmp_path_factory.mktemp("browser")) as page:
        yield page


def sheets(pdf: bytes) -> list[int]:
    """How much is drawn on each printed sheet, in bytes of its compressed content."""
    found = re.findall(rb"/Type /Page\b.*?/Contents (\d+) 0 R", pdf, re.DOTALL)
    sizes = (re.search(rb"\n%s 0 obj\s*<<[^>]*/Length (\d+)" % number, pdf) for number in found)
    return [int(size[1]) for size in sizes if size]


@pytest.mark.parametrize("kind", PAGES)
def test_a_page_has_no_words_of_the_derivations(kind: str) -> None:
    seen = re.sub(r"<(script|style)>.*?</\1>|<[^>]*>", " ", PAGES[kind](), flags=re.DOTALL)
    assert re.findall(r"(?i)\b(?:nats|floors?|excess|pulls?|boards?)\b", seen) == []


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: the pages are not opened in a browser")
@pytest.mark.parametrize("kind", PAGES)
def test_a_page_fits_screens_and_paper(browser: Page, tmp_path: Path, kind: str) -> None:
    file = tmp_path / "page.html"
    file.write_text(PAGES[kind](), encoding="utf-8")
    browser.call("Page.navigate", url=file.as_uri())
    browser.wait_for("document.readyState === 'complete' && !!document.querySelector('main')")
    for width in (1400, 420):
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.call("Emulation.setDeviceMetricsOverride", **size)
        assert browser.js(FAULTS) == [], width
    browser.call("Emulation.clearDeviceMetricsOverride")
    printed = browser.call("Page.printToPDF", printBackground=True, paperWidth=8.27, paperHeight=11.69)
    drawn = sheets(base64.b64decode(printed["data"]))
    assert drawn
    assert min(drawn) > 400, f"a sheet is nearly blank: {drawn}"
