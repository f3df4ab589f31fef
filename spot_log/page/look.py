"""One look for the pages of figures: colours for light and dark, one tooltip, print, and the frame of a page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from spot_log.page.svg import esc

STYLE: Final = """
:root { color-scheme: light dark; --ink: #1d2730; --soft: #5c6b78; --line: #dbe2e8; --card: #ffffff; --page: #f2f5f7;
  --chip: #eaeff3; --real: #1d2730; --nominal: #c8402f; --corrected: #1f8a5b; --floor: #2f6fb5; --found: #c8402f;
  --group: #e2915c; --other: #9aa7b2; --none: #2f6fb5; --unknown: #8446a8; --body: #f2c21b; --edge: #86690a;
  --leg: #46535e; --empty: #e6ebef; --good: #1f8a5b; --warn: #b7791f; --bad: #c8402f; --cause: #8446a826; }
@media screen and (prefers-color-scheme: dark) { :root { --ink: #e6ecf1; --soft: #9fb0bd; --line: #34414c;
  --card: #1c242b; --page: #12181d; --chip: #2a353f; --real: #f1f5f8; --nominal: #ff7a66; --corrected: #4fd39a;
  --floor: #6db0f2; --found: #ff7a66; --group: #eaa678; --other: #6d7c88; --none: #6db0f2; --unknown: #c791ea;
  --body: #d8ad18; --edge: #f3d568; --leg: #93a3b0; --empty: #2a353f; --good: #4fd39a; --warn: #eeb24e;
  --bad: #ff7a66; } }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, "Segoe UI", sans-serif; color: var(--ink); background: var(--page); margin: 0; }
main { max-width: 1240px; margin: 0 auto; padding: 24px 20px 60px; }
h1 { font-size: 27px; line-height: 1.25; margin: 10px 0 6px; } h2 { font-size: 18px; margin: 0 0 2px; }
h3 { font-size: 15px; margin: 18px 0 4px; }
section { background: var(--card); border: 1px solid var(--line); border-radius: 12px; padding: 18px 20px;
  margin: 16px 0; }
.two { display: grid; grid-template-columns: 1fr 1fr; gap: 16px; margin: 16px 0; } .two section { margin: 0; }
@media (max-width: 900px) { .two { grid-template-columns: 1fr; } }
.note { color: var(--soft); margin: 0 0 10px; font-size: 13.5px; }
.meta { color: var(--soft); font-size: 14px; margin: 0; }
.badge { display: inline-block; padding: 3px 12px; border-radius: 20px; color: #fff;
  font-weight: 600; font-size: 14px; }
.explained { background: #1f8a5b; } .partly_explained { background: #b7791f; } .unknown_effect { background: #8446a8; }
.no_gap { background: #2f6fb5; } .cannot_tell { background: #5c6b78; }
.lead { font-size: 17px; margin: 4px 0 0; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
td, th { text-align: left; vertical-align: top; padding: 5px 14px 5px 0; border-bottom: 1px solid var(--line); }
th { color: var(--soft); font-weight: 500; } tr:last-child td, tr:last-child th { border-bottom: 0; }
code { background: var(--chip); padding: 1px 6px; border-radius: 5px; font-size: 13px; overflow-wrap: anywhere; }
pre { background: var(--chip); padding: 10px 12px; border-radius: 8px; font-size: 13px; margin: 6px 0;
  white-space: pre-wrap; overflow-wrap: anywhere; }
ul, ol { margin: 6px 0 0; padding-left: 22px; } li { margin: 4px 0; }
.chip { display: inline-block; background: var(--chip); border-radius: 14px; padding: 1px 10px; margin: 2px 4px 2px 0;
  font-size: 13px; } .chip.off { opacity: .6; text-decoration: line-through; }
svg { display: block; width: 100%; height: auto; } svg text { fill: var(--ink); font-family: inherit; }
svg .soft { fill: var(--soft); } svg .grid { stroke: var(--line); stroke-width: 1; fill: none; }
[data-t] { cursor: default; } svg [data-t]:hover { stroke: var(--ink); stroke-width: 2; }
#tip { position: fixed; display: none; pointer-events: none; z-index: 9; background: var(--ink); color: var(--card);
  padding: 6px 10px; border-radius: 6px; font-size: 13px; white-space: pre-line; max-width: 340px; }
.legend span { display: inline-flex; align-items: center; margin-right: 18px; font-size: 13.5px; color: var(--soft); }
.legend i { width: 14px; height: 14px; border-radius: 3px; margin-right: 6px; display: inline-block; }
.good { background: #1f8a5b; } .fair { background: #b7791f; } .bad { background: #c8402f; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
details { margin: 6px 0; } summary { cursor: pointer; font-weight: 500; }
.panels { display: grid; grid-template-columns: repeat(4, 1fr); gap: 6px 8px; }
section { overflow-x: auto; } h1 { overflow-wrap: anywhere; }
/* On a narrow screen a figure of half a page fits; a wider one keeps its labels' size and is moved sideways. */
@media (max-width: 700px) { section svg { min-width: clamp(0px, 1000 * (var(--width) - 700px), 0.9 * var(--width)); }
  .panels { grid-template-columns: 1fr 1fr; } td:has(code) { min-width: 220px; }
  section > h2, section > h3, section > p { position: sticky; left: 0; } main { padding: 12px 10px 40px; } }
@media print { section { break-inside: avoid; } body { background: #fff; } h1 { font-size: 22px; } }
"""

SCRIPT: Final = """
const tip = document.getElementById('tip');
document.addEventListener('mousemove', e => {
  const at = e.target.closest('[data-t]');
  if (!at) { tip.style.display = 'none'; return; }
  tip.textContent = at.dataset.t; tip.style.display = 'block';
  const w = tip.offsetWidth, h = tip.offsetHeight;
  tip.style.left = Math.max(4, Math.min(e.clientX + 14, innerWidth - w - 6)) + 'px';
  tip.style.top = (e.clientY + h + 24 < innerHeight ? e.clientY + 16 : e.clientY - h - 10) + 'px';
});
"""


def framed(title: str, body: Iterable[str], style: str = "", head: str = "") -> str:
    """A whole page: one file that opens from disk and loads nothing from elsewhere.

    Args:
        title: For the browser.
        body: Sections, as HTML.
        style: More CSS.
        head: More HTML for the page's head.
    """
    return (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{esc(title)}</title>"
        "<meta name='viewport' content='width=device-width'><link rel='icon' href='data:,'>"
        f"<style>{STYLE}{style}</style>{head}</head><body><main>{''.join(body)}</main><div id='tip'></div>"
        f"<script>{SCRIPT}</script></body></html>\n"
    )


def boxed(title: str, about: str, content: str) -> str:
    """A box with a heading and a line of explanation; empty without content."""
    told = f"<p class='note'>{esc(about)}</p>" if about else ""
    return f"<section><h2>{esc(title)}</h2>{told}{content}</section>" if content else ""


def panels(drawn: Iterable[str]) -> str:
    """Small plots in four columns."""
    return f"<div class='panels'>{''.join(f'<div>{d}</div>' for d in drawn if d)}</div>"


def headed(badge: str, kind: str, headline: str, lines: Iterable[str], meta: str = "") -> str:
    """The first box: a verdict in a word, a headline, sentences.

    Args:
        badge: The verdict's word.
        kind: good, fair or bad, or another class of the style.
        headline: The first heading.
        lines: Sentences below it.
        meta: Where it comes from.
    """
    told = "".join(f"<p class='lead'>{esc(line)}</p>" for line in lines)
    about = f"<p class='meta' style='margin-top:12px'>{esc(meta)}</p>" if meta else ""
    return f"<section><span class='badge {kind}'>{esc(badge)}</span><h1>{esc(headline)}</h1>{told}{about}</section>"
