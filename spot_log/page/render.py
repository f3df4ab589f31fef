"""The one renderer of pages: HTML from the parts in ``sections.py``. All text is escaped by :func:`esc`."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from spot_log.page import sections as s
from spot_log.page.draw import HEAT, RIGHT, drawn, esc, heat, on_heat, tipped
from spot_log.page.spot_drawing import spot_svg

_STYLE, _SCRIPT = (files(__package__).joinpath(name).read_text(encoding="utf-8") for name in ("look.css", "look.js"))


def rendered(title: str, parts: s.Content) -> str:
    """A whole page: one file that opens from disk and loads nothing from elsewhere."""
    return (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{esc(title)}</title>"
        "<meta name='viewport' content='width=device-width'><link rel='icon' href='data:,'>"
        f"<style>{_STYLE}</style></head><body><main>{as_html(parts)}</main><div id='tip'></div>"
        f"<script>{_SCRIPT}</script></body></html>\n"
    )


def as_html(part: s.Content, columns: int = 1, is_within: bool = False) -> str:
    """Parts of a page in one of some columns, or within a section; empty where there is nothing to show."""
    match part:
        case s.Head():
            lead = "".join(f"<p class='lead'>{esc(line)}</p>" for line in part.lines if line)
            badge = f"<span class='badge {part.kind}'>{esc(part.badge)}</span>"
            return f"<section>{badge}<h1>{esc(part.headline)}</h1>{lead}{_p(part.meta, 'meta')}</section>"
        case s.Section(title, about, content, look):
            tag, heading = ("div", "h3") if is_within else (f"section class='{look}'" if look else "section", "h2")
            inside = as_html(content, columns, is_within=True)
            return inside and _wrapped(tag, f"<{heading}>{esc(title)}</{heading}>{_p(about, 'note')}{inside}")
        case s.Fold(title, content):
            inside = as_html(content, is_within=True)
            return inside and f"<details><summary>{esc(title)}</summary>{inside}</details>"
        case s.Beside(parts, n):
            there = [inside for p in parts if (inside := as_html(p, n, is_within))]
            boxes = "".join(p if p.startswith(("<section", "<details")) else f"<div>{p}</div>" for p in there)
            return f"<div class='columns c{n}'>{boxes}</div>" if len(there) > 1 else "".join(there)
        case s.Items():
            lines = "".join(f"<li>{_words(item)}</li>" for item in part.items)
            return _wrapped("ol" if part.is_numbered else "ul", lines)
        case s.Table():
            return _table(part)
        case s.Legend():
            marks = (f"<span><i style='background:{c}'></i>{esc(words)}</span>" for c, words in part.entries if words)
            return _wrapped("p class='legend'", "".join(marks))
        case s.Chart():
            return _chart(part, columns)
        case s.Bars():
            return _bars(part)
        case s.Map():
            return _map(part)
        case s.SpotMap():
            return spot_svg(part) + _scale(part.scale)
        case s.Mark(text, look):
            return _words(part) if look == "pre" else _p(text, look)
        case list():
            return "".join(as_html(p, columns, is_within) for p in part)
        case str() | tuple():
            return _p(part, "")
    return ""


def _wrapped(tag: str, inside: str) -> str:
    return f"<{tag}>{inside}</{tag.partition(' ')[0]}>" if inside else ""


def _p(words: s.Words, look: str) -> str:
    return _wrapped(f"p class='{look}'" if look else "p", _words(words))


def _words(words: s.Words) -> str:
    match words:
        case s.Mark(text, look, link) if link:
            return f"<a class='{look}' href='{esc(link)}'>{esc(text)}</a>"
        case s.Mark(text, ("b" | "code" | "pre") as tag):
            return f"<{tag}>{esc(text)}</{tag}>"
        case s.Mark(text, look):
            return f"<span class='{look}'>{esc(text)}</span>" if text else ""
        case tuple():
            return "".join(map(_words, words))
    return esc(words)


def _table(t: s.Table) -> str:
    rows = list(t.rows)
    if not rows:
        return ""
    is_many = len(rows[0]) >= 4
    names = t.head if is_many and t.head else [""] * len(rows[0])
    lines = [_wrapped("tr", "".join(f"<th>{esc(name)}</th>" for name in t.head))]
    for row, look in zip(rows, t.looks or [""] * len(rows), strict=True):
        cells = list(map(_cell, row, names))
        if not t.head:
            cells[0] = f"<th>{_words(row[0])}</th>"
        lines.append(f"<tr class='{look}'>{''.join(cells)}</tr>" if look else f"<tr>{''.join(cells)}</tr>")
    return f"<table{' class=many' if is_many else ''}>{''.join(lines)}</table>"


def _cell(value: s.Words, name: str) -> str:
    head = f' data-head="{esc(name)}"' if name else ""
    if isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
        return f"<td{head}>{_words(value)}</td>"
    text = "—" if value is None else str(value) if isinstance(value, int) else f"{value:.4g}"
    return f'<td class="number"{head}>{text}</td>'


def _chart(c: s.Chart, columns: int) -> str:
    left, height, inside = drawn(c, {1: 8, 2: 5}.get(columns, 3))
    head = _wrapped("h4", esc(c.title)) + _p(c.about, "note")
    if not inside:
        return head if c.about else ""
    look = f'class="wide" style="height:{height:g}px;padding:0 {RIGHT}px 0 {left}px" role="img"'
    label = f"{c.y_title or c.title or ', '.join(c.rows)} over {c.x_title or 'time'}"
    return f'{head}<svg {look} aria-label="{esc(label)}">{inside}</svg>'


def _bars(b: s.Bars) -> str:
    parts = []
    for name, below, group in b.groups:
        parts.append(f"<b>{esc(name)}{_wrapped('small', esc(below))}</b><div>")
        for bar in group:
            look = f"width:{100 * bar.share:.1f}%;background:{bar.colour}"
            parts.append(f"<div><i style='{look}'{tipped(bar.tip)}></i><span>{esc(bar.words)}</span></div>")
        parts.append("</div>")
    return f'<div class="bars" role="img" aria-label="{esc(b.label)}">{"".join(parts)}</div>'


def _map(m: s.Map) -> str:
    names = "".join(f"<th><span>{esc(name)}</span></th>" for name in m.columns)
    lines = [f"<tr><th><h4>{esc(m.title)}</h4></th>{names}</tr>"]
    for name, cells in m.rows:
        looks = ("" if c.share is None else f"background:{heat(c.share)};color:{on_heat(c.share)}" for c in cells)
        row = (f"<td style='{k}'{tipped(c.tip)}>{esc(c.words)}</td>" for k, c in zip(looks, cells, strict=True))
        lines.append(f"<tr><th>{esc(name)}</th>{''.join(row)}</tr>")
    return f'<table class="map" aria-label="{esc(m.label)}">{"".join(lines)}</table>{_scale(m.scale)}'


def _scale(words: Any) -> str:
    colours = ",".join(heat(i / (len(HEAT) - 1)) for i in range(len(HEAT)))
    told = "".join(f"<span>{esc(w)}</span>" for w in words)
    return f"<div class='scale'><i style='background:linear-gradient(90deg,{colours})'></i>{told}</div>" if told else ""
