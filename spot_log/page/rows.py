"""Pictures in rows, as SVG: bars of a size, bands over time, feet on the ground, and maps of colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from spot_log.page.chart import Shade
from spot_log.page.svg import WIDE, Frame, dot, esc, heat, on_heat, placed, rect, stretched, text, wide

_ROW: Final = 18
_COLOURS_SHOWN: Final = 40
_HEAT_RIGHT: Final = 22
"""Room for the slope of the last column's name, pixels."""


class Bar(NamedTuple):
    """One bar of a group."""

    share: float
    """Length as a share of the full length, 0 to 1."""
    colour: str
    words: str
    """Behind the bar."""
    tip: str = ""


class Cell(NamedTuple):
    """One cell of a map of colours."""

    share: float | None
    """Place on the scale of colours, 0 to 1; None where nothing is known."""
    tip: str = ""
    words: str = ""
    is_marked: bool = False
    """Whether it has a dot."""


def bars(groups: Sequence[tuple[str, str, Sequence[Bar]]], label: str, *, left: float = 150, right: float = 66) -> str:
    """Groups of bars.

    Args:
        groups: Name, what stands small below it, and bars.
        label: What it shows, for those who cannot see it.
        left: Room for the names, pixels.
        right: Room for the words behind the longest bar, pixels.
    """
    names, drawn, y = [], [], 4.0
    for name, below, group in groups:
        is_single = len(group) == 1
        names.append(text(-10, y + (13 if is_single else 22), name, size=13.5, anchor="end", weight=600))
        names.append(text(-10, y + 38, below, size=12, anchor="end", css="soft") if below else "")
        for bar in group:
            told = f' data-t="{esc(bar.tip)}"' if bar.tip else ""
            look = f'width="{100.0 * bar.share:.2f}%" height="14" rx="2" style="fill:{bar.colour}"'
            words = text(6, y + 12, bar.words, size=12.5)
            drawn.append(f'<rect x="0" y="{y:g}" {look}{told}/>{placed(100.0 * bar.share, 0, words)}')
            y += 16
        y += 10 if is_single else 14
    return wide(y, [*names, *drawn], label, left=left, right=right)


def bands(
    rows: Sequence[tuple[str, Sequence[Shade]]],
    span: tuple[float, float],
    label: str,
    *,
    width: float = WIDE,
    left: float = 62,
    x_unit: str | None = " s",
) -> str:
    """Stretches of one axis, a row each name; later ones lie on top.

    Args:
        rows: Name, and stretches.
        span: Begin and end of the axis.
        label: What it shows, for those who cannot see it.
        width: Of the picture.
        left: Room for the names.
        x_unit: Behind the numbers of the axis; None: no axis.
    """
    frame = Frame(span, (0.0, 1.0), width, _ROW * len(rows), left=left, top=4)
    names, drawn = [], []
    for i, (name, stretches) in enumerate(rows):
        y = frame.top + _ROW * i
        names.append(text(-8, y + 12, name, size=12, anchor="end"))
        for s in stretches:
            begin, end = frame.at(s.start, 0.0)[0], frame.at(s.end, 0.0)[0]
            drawn.append(rect(begin, y, end - begin, _ROW - 4, s.colour, s.tip, radius=0))
    parts = [*names, frame.plot(drawn)]
    if x_unit is None:
        return frame.picture(frame.top + frame.height, parts, label)
    return frame.picture(frame.total_height, [*parts, *frame.across(x_unit)], label)


def stance(
    contact: ArrayLike, names: Sequence[str], colour: str, *, width: float = WIDE, span_s: tuple[float, float] = (0, 0)
) -> str:
    """Feet on the ground over a stretch of time, one row a foot; an empty text where there is none.

    Args:
        contact: Whether each foot is down, samples at even times. Shape (n, feet).
        names: Of the feet.
        colour: Of the bars.
        width: Of the picture.
        span_s: Begin and end on the axis of time below; no axis without them.
    """
    down = np.asarray(contact, dtype=np.bool_)
    if down.ndim != 2 or down.shape[1] != len(names) or not len(down):
        return ""
    has_axis = span_s[1] > span_s[0]
    first, last = span_s if has_axis else (0.0, float(len(down)))
    rows = []
    for foot, name in enumerate(names):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], down[:, foot].astype(int), [0]])))
        at = first + (last - first) * edges.reshape(-1, 2) / len(down)
        stands = [Shade(float(a), float(b), f"{name} on the ground", colour) for a, b in at]
        rows.append((name, [Shade(first, last, "", "var(--empty)"), *stands]))
    return bands(rows, (first, last), "Feet on the ground", width=width, x_unit=" s" if has_axis else None)


def heat_map(
    columns: Sequence[str],
    rows: Sequence[tuple[str, Sequence[Cell]]],
    label: str,
    *,
    title: str = "",
    left: float = 130,
    row: float = 30,
    scale: Sequence[str] = (),
) -> str:
    """A map of colours: rows down, columns across, whose names stand on a slope.

    Args:
        columns: Their names.
        rows: Name, and a cell each column.
        label: What it shows, for those who cannot see it.
        title: Above the names of the rows.
        left: Room for the names of the rows, pixels.
        row: Height of one, pixels.
        scale: Words below the scale of colours; no scale without them.
    """
    top, height, n = 74.0, row * len(rows), len(columns)
    parts = [text(-10, 40, title, size=15, anchor="end", weight=600) if title else ""]
    middles = [100.0 * (j + 0.5) / n for j in range(n)]
    boxes, over = [], []
    for at, name in zip(middles, columns, strict=True):
        words = text(0, 0, name, size=12, css="soft cell")
        over.append(placed(at, top - 6, f'<g transform="translate(4 0) rotate(-60)">{words}</g>'))
    for i, (name, cells) in enumerate(rows):
        y = row * i
        parts.append(text(-10, top + y + 0.5 * row + 4, name, size=12.5, anchor="end"))
        for j, cell in enumerate(cells):
            fill, ink = ("var(--empty)", "") if cell.share is None else (heat(cell.share), on_heat(cell.share))
            boxes.append(rect(10 * j, y, 9.7, row - 1.5, fill, cell.tip, radius=0))
            if cell.words:
                middle = f"{middles[j]:.2f}%"
                over.append(
                    text(middle, top + y + 0.5 * row + 4, cell.words, size=12, anchor="middle", css="cell", fill=ink)
                )
            if cell.is_marked:
                boxes.append(f'<g pointer-events="none">{dot(10 * j + 4.85, y + 0.5 * row - 0.75, 2.2, ink)}</g>')
    parts += [
        stretched(top, height, boxes, f"0 0 {10 * n} {height:g}"),
        f'<g pointer-events="none">{"".join(over)}</g>',
    ]
    bottom = top + height
    if scale:
        parts.append(placed(100.0, bottom + 14, scale_bar(-250, 0, 240, scale)))
        bottom += 48
    return wide(bottom, parts, label, left=left, right=_HEAT_RIGHT)


def scale_bar(x: float, y: float, width: float, words: Sequence[str]) -> str:
    """The scale of colours with words at even distances below it."""
    n = _COLOURS_SHOWN
    parts = [rect(x + i * width / n, y, width / n + 0.5, 10, heat((i + 0.5) / n), radius=0) for i in range(n)]
    at = np.linspace(x, x + width, len(words))
    parts += [text(a, y + 24, w, size=11, anchor="middle", css="soft") for a, w in zip(at, words, strict=True)]
    return "".join(parts)
