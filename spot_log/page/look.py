"""One look for the pages of figures: colours for light and dark, one tooltip, print, and the frame of a page."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.resources import files
from typing import Final

from spot_log.page.svg import esc

_HERE: Final = files(__package__)
STYLE: Final = (_HERE / "look.css").read_text(encoding="utf-8")
SCRIPT: Final = (_HERE / "look.js").read_text(encoding="utf-8")


def framed(title: str, body: Iterable[str], style: str = "", head: str = "") -> str:
    """A whole page: one file that opens from disk and loads nothing from elsewhere."""
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
    """The first box: a verdict in a word and its CSS class, a headline, sentences, and where it comes from."""
    told = "".join(f"<p class='lead'>{esc(line)}</p>" for line in lines)
    about = f"<p class='meta' style='margin-top:12px'>{esc(meta)}</p>" if meta else ""
    return f"<section><span class='badge {kind}'>{esc(badge)}</span><h1>{esc(headline)}</h1>{told}{about}</section>"
