"""One look for the pages of figures: colours for light and dark, one tooltip, print, and the frame of a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.resources import files
from typing import Final

from spot_log.page.svg import esc


class Html(str):
    """Text that is HTML already; all other text is escaped."""

    __slots__ = ()


def table(head: Sequence[str], rows: Iterable[Sequence[object]], *, row_classes: Sequence[str] = ()) -> Html:
    """A table; empty without rows. One of many columns is a list of its rows on a narrow screen."""
    rows = list(rows)
    if not rows:
        return Html("")
    names = "".join(f"<th>{escaped(name)}</th>" for name in head)
    lines = [f"<tr>{names}</tr>"] if head else []
    is_many = len(rows[0]) >= _MANY_COLUMNS
    heads = head if is_many and head else [""] * len(rows[0])
    for i, row in enumerate(rows):
        css = f' class="{escaped(row_classes[i])}"' if row_classes else ""
        lines.append(f"<tr{css}>{''.join(map(_cell, row, heads))}</tr>")
    return Html(f"<table{' class=many' if is_many else ''}>{''.join(lines)}</table>")


def facts(rows: Iterable[tuple[str, object]]) -> Html:
    """A table of names, each with its text."""
    lines = [f"<tr><th>{escaped(name)}</th>{_cell(value)}</tr>" for name, value in rows]
    return Html(f"<table>{''.join(lines)}</table>")


def note(text: str) -> Html:
    """A line of explanation; nothing for an empty one."""
    return Html(f'<p class="note">{escaped(text)}</p>' if text else "")


def escaped(text: object) -> str:
    """Text as HTML; :class:`Html` as it is."""
    return str(text) if isinstance(text, Html) else esc(text)


def _cell(value: object, head: str = "") -> str:
    told = f' data-head="{escaped(head)}"' if head else ""
    if isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
        return f"<td{told}>{escaped(value)}</td>"
    text = "—" if value is None else str(value) if isinstance(value, int) else f"{value:.4g}"
    return f'<td class="number"{told}>{text}</td>'


_MANY_COLUMNS: Final = 4
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


def listed(items: Iterable[object], tag: str = "ul") -> str:
    """A list of texts; empty without any."""
    lines = "".join(f"<li>{escaped(item)}</li>" for item in items)
    return f"<{tag}>{lines}</{tag}>" if lines else ""


def folded(title: str, content: str) -> str:
    """What opens on a click; nothing without content."""
    return f"<details><summary>{esc(title)}</summary>{content}</details>" if content else ""


def beside(*parts: str) -> str:
    """Side by side where there is room for it."""
    there = [f"<div>{p}</div>" if p.startswith("<svg") else p for p in parts if p]
    return f"<div class='two'>{''.join(there)}</div>" if len(there) > 1 else "".join(there)
