"""Tables of pages: text is escaped, numbers stand to the right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from spot_log.page.svg import esc


class Html(str):
    """Text that is HTML already; all other text is escaped."""

    __slots__ = ()


def table(head: Sequence[str], rows: Iterable[Sequence[object]], *, row_classes: Sequence[str] = ()) -> Html:
    """A table."""
    names = "".join(f"<th>{escaped(name)}</th>" for name in head)
    lines = [f"<tr>{names}</tr>"] if head else []
    for i, row in enumerate(rows):
        css = f' class="{escaped(row_classes[i])}"' if row_classes else ""
        lines.append(f"<tr{css}>{''.join(map(_cell, row))}</tr>")
    return Html(f"<table>{''.join(lines)}</table>")


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


def _cell(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
        return f"<td>{escaped(value)}</td>"
    text = "—" if value is None else str(value) if isinstance(value, int) else f"{value:.4g}"
    return f'<td class="number">{text}</td>'
