"""Pages: one look for all of them. A page is one HTML file that opens from disk and needs no network."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any, Final

from spot_log.page.errors import PlotlyMissingError


class Html(str):
    """Text that is HTML already; all other text is escaped."""

    __slots__ = ()


STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, sans-serif; color: #26313b; background: #f4f6f8; margin: 0; }
main { max-width: 1320px; margin: 0 auto; padding: 20px; }
h1 { font-size: 24px; margin: 4px 0 2px; } h2 { font-size: 18px; margin: 0 0 2px; }
section { background: #fff; border: 1px solid #dde3e8; border-radius: 8px; padding: 14px 18px; margin: 14px 0; }
p.note { color: #61707d; margin: 0 0 4px; font-size: 13px; overflow-wrap: anywhere; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
td, th { text-align: left; vertical-align: top; padding: 3px 12px 3px 0; border-bottom: 1px solid #edf0f3; }
th { color: #61707d; font-weight: 500; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.good { color: #1e7d4f; } .bad { color: #b03030; font-weight: 600; }
.warning { color: #9a6a00; } .error { color: #b03030; }
h1, td, li { overflow-wrap: anywhere; } section { overflow-x: auto; } .plotly-graph-div { min-width: 620px; }
pre { white-space: pre-wrap; word-break: break-word; margin: 0; font-size: 12px; max-height: 220px; overflow: auto; }
details > summary { cursor: pointer; color: #61707d; }
"""
MEASURED: Final = "#1f6fb2"
ASKED: Final = "#d1662b"
LIMIT: Final = "#b03030"
NEUTRAL: Final = "#7a8794"
FEET: Final = ("#1f6fb2", "#d1662b", "#3c8d5a", "#8e5aa8")
"""Colours of what was measured, of what was asked for, of limits, of all else, and of the feet fl, fr, hl, hr."""

_BUTTONS: Final = [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "autoScale2d", "resetScale2d"]]
_CONFIG: Final = {"displaylogo": False, "responsive": True, "modeBarButtons": _BUTTONS}


def page(title: str, body: Iterable[str], *, note: str = "", style: str = "", has_plots: bool = True) -> str:
    """The whole page.

    Args:
        title: Of the page and its first heading.
        body: Sections, as HTML.
        note: A line below the heading.
        style: More CSS.
        has_plots: Whether plotly.js goes in, once for all figures.

    Raises:
        PlotlyMissingError: There are plots, and plotly is not installed.
    """
    script = f"<script>{_plotly_js()}</script>" if has_plots else ""
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escaped(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE}{style}</style>{script}</head>\n<body><main><h1>{escaped(title)}</h1>{told(note)}\n"
        + "\n".join(body)
        + "\n</main></body></html>\n"
    )


def section(heading: str, body: str, note: str = "") -> Html:
    """A box; ``heading`` and ``note`` are text, each may be empty, ``body`` is HTML."""
    title = f"<h2>{escaped(heading)}</h2>" if heading else ""
    return Html(f"<section>{title}{told(note)}{body}</section>")


def table(head: Sequence[str], rows: Iterable[Sequence[object]], *, row_classes: Sequence[str] = ()) -> Html:
    """A table; numbers stand to the right, text is escaped unless it is :class:`Html`.

    Args:
        head: Names of the columns; none for a table without them.
        rows: Cells; floats are given four digits, None a dash.
        row_classes: CSS class of each row.
    """
    names = "".join(f"<th>{escaped(name)}</th>" for name in head)
    lines = [f"<tr>{names}</tr>"] if head else []
    for i, row in enumerate(rows):
        css = f' class="{escaped(row_classes[i])}"' if row_classes else ""
        lines.append(f"<tr{css}>{''.join(map(_cell, row))}</tr>")
    return Html(f"<table>{''.join(lines)}</table>")


def facts(rows: Iterable[tuple[str, object]]) -> Html:
    """A table of names and what is to be said of each."""
    lines = [f"<tr><th>{escaped(name)}</th>{_cell(value)}</tr>" for name, value in rows]
    return Html(f"<table>{''.join(lines)}</table>")


def bullets(items: Iterable[str]) -> Html:
    """A list; text is escaped unless it is :class:`Html`."""
    return Html("<ul>" + "".join(f"<li>{escaped(item)}</li>" for item in items) + "</ul>")


def told(note: str) -> Html:
    """A line of explanation; nothing for an empty one."""
    return Html(f'<p class="note">{escaped(note)}</p>' if note else "")


def folded(summary: str, body: str, *, is_open: bool = False) -> Html:
    """HTML that a click shows."""
    return Html(f"<details{' open' if is_open else ''}><summary>{escaped(summary)}</summary>{body}</details>")


def marked(text: object, css: str) -> Html:
    """Text of a CSS class: good, bad, warning, error."""
    return Html(f'<span class="{css}">{escaped(text)}</span>')


def plot(figure: Any, name: str | None = None) -> Html:
    """A plotly figure, or a word where it is None."""
    if figure is None:
        return told("The log has no data for this.")
    div_id = None if name is None else f"figure-{name}"
    return Html(figure.to_html(full_html=False, include_plotlyjs=False, div_id=div_id, config=_CONFIG))


def styled(figure: Any, height: int, *, legend: bool = True, title: str = "", x: str = "", y: str = "") -> Any:
    """The same figure in the look of all pages; ``x`` and ``y`` name its axes."""
    figure.update_layout(
        height=height,
        margin={"l": 62, "r": 18, "t": 56, "b": 44},
        showlegend=legend,
        template="plotly_white",
        hovermode="x",
        bargap=0,
        font={"family": "system-ui, sans-serif", "size": 12, "color": "#26313b"},
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1 + 22 / (height - 90), "yanchor": "bottom"},
    )
    if title:
        figure.update_layout(title={"text": title, "font": {"size": 14}})
    if x or y:
        figure.update_layout(xaxis_title=x, yaxis_title=y)
    figure.update_annotations(font_size=12)
    return figure


def escaped(text: object) -> str:
    """Text as HTML; :class:`Html` as it is."""
    return str(text) if isinstance(text, Html) else html.escape(str(text))


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "—" if value is None else f"{value:.4g}"


def _cell(value: object) -> str:
    if value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
        text = str(value) if isinstance(value, int) else number(value)
        return f'<td class="number">{text}</td>'
    return f"<td>{escaped(value)}</td>"


def _plotly_js() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise PlotlyMissingError from error
    return str(get_plotlyjs())
