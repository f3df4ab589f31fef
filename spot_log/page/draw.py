"""Charts as SVG, and what they share with the drawing of Spot."""

from __future__ import annotations

import html
from collections.abc import Iterable
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.page.sections import Chart, Series
from spot_model.text import plain_lines

MAX_POINTS: Final = 600
ACROSS: Final = 1000.0
"""Width of a plot in units of its own; it is stretched to the width of its place."""
RIGHT: Final = 12
"""Room beside the plot, pixels."""
HEAT: Final = ((255, 246, 219), (254, 217, 118), (253, 141, 60), (227, 26, 28), (128, 0, 38))
"""Pale to dark red."""

Point = tuple[float, float]


def esc(text: object) -> str:
    """Text for HTML or an attribute, without what a reader cannot see."""
    return html.escape(plain_lines(str(text)), quote=True)


def tipped(tip: str) -> str:
    """The attribute of what tells more while the mouse is on it."""
    return f' data-t="{esc(tip)}"' if tip else ""


def heat(share: float) -> str:
    """A colour of the scale, share 0 to 1."""
    at = min(max(share, 0.0), 1.0) * (len(HEAT) - 1)
    return "#" + "".join(f"{round(float(np.interp(at, range(len(HEAT)), c))):02x}" for c in zip(*HEAT, strict=True))


def on_heat(share: float) -> str:
    """A colour of words that can be read on it."""
    return "#ffffff" if share > 0.62 else "#1d2730"


def drawn(c: Chart, n_across: int) -> tuple[int, float, str]:
    """Draw a chart.

    Returns:
        Room left of the plot and the height of all, in pixels, and what is to be seen; the last is empty where no
        value is finite. Places across are percent of the plot's width, so that words keep their size.
    """
    lines = [(s, np.asarray(s.x, dtype=np.float64), np.asarray(s.y, dtype=np.float64)) for s in c.lines]
    lines = [found for found in lines if np.isfinite(found[2]).any()]
    if not lines:
        return 0, 0.0, ""
    low, high = (float(f([f(y[np.isfinite(y)]) for _, _, y in lines])) for f in (np.min, np.max))
    # A line that hardly moves is no mountain range.
    span = max(high - low, 0.01 * max(abs(low), abs(high)), 1e-6)
    pad = max(0.06 * span, 0.5 * (max(c.least_span, span) - (high - low)))
    low, high = c.y_range or (0.0 if c.zero else low - pad, high + pad)
    first, last = min(float(x.min()) for _, x, _ in lines), max(float(x.max()) for _, x, _ in lines)

    def across(x: Any) -> Any:
        return ACROSS * (x - first) / max(last - first, 1e-9)

    def down(y: Any) -> Any:
        return c.height * (high - y) / max(high - low, 1e-12)

    top, left = 8, 62 if c.y_title else 44
    plot, around = [], []
    for shade in c.shades:
        begin, end = (min(max(float(across(x)), 0.0), ACROSS) for x in (shade.start, shade.end))
        size = f'width="{max(end - begin, 1.5):.1f}" height="{c.height:g}"'
        plot.append(f'<rect x="{begin:.1f}" y="0" {size} style="fill:{shade.colour}"{tipped(shade.tip)}/>')
    ticks = [(-float(i), name) for i, name in enumerate(c.rows)] or [(t, f"{t:g}") for t in nice_ticks(low, high, 4)]
    for tick, name in ticks:
        at = float(down(tick))
        around.append(words(-8, top + at + 4, name, anchor="end"))
        if not c.rows:
            plot.append(as_line([(0.0, at), (ACROSS, at)], "currentColor", 1, "stroke-opacity:.16"))
    for s, x, y in lines:
        plot += _series(s, x, y, across(x), down(y))
    look = f'viewBox="0 0 {ACROSS:g} {c.height:g}" preserveAspectRatio="none" width="100%" height="{c.height:g}"'
    parts, bottom = [f'<svg y="{top}" {look} overflow="visible">{"".join(plot)}</svg>', *around], top + c.height + 4
    if c.x_unit is not None:
        marks, bottom = nice_ticks(first, last, n_across), bottom + 20
        for i, tick in enumerate(marks):
            css = "few" if i % 2 and len(marks) > 6 else ""
            x_percent = f"{float(across(tick)) * 100 / ACROSS:.2f}%"
            parts.append(words(x_percent, bottom - 8, f"{tick:g}{c.x_unit}", anchor="middle", css=css))
    if c.x_title:
        parts.append(words("50%", bottom + 12, c.x_title))
    if c.y_title:
        turned = f"translate({14 - left} {top + c.height / 2:.0f}) rotate(-90)"
        parts.append(f'<g transform="{turned}">{words(0, 0, c.y_title)}</g>')
    return left, bottom + (20 if c.x_title else 0), "".join(parts)


def words(x: float | str, y: float, text: object, *, anchor: str = "middle", css: str = "", more: str = "") -> str:
    """Words at their baseline; ``x`` may be a percentage, such as "50%"."""
    look = f'font-size="12" fill="currentColor" text-anchor="{anchor}"' + (f' class="{css}"' if css else "") + more
    return f'<text x="{x}" y="{y:.1f}" {look}>{esc(text)}</text>'


def as_line(points: Iterable[Point], colour: str, width: float, more: str = "", fill: str = "none") -> str:
    """An open line, as wide as it is where the picture is stretched."""
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    look = f"fill:{fill};stroke:{colour};stroke-width:{width:g};stroke-linejoin:round;vector-effect:non-scaling-stroke"
    return f'<polyline points="{way}" style="{look};{more}"/>'


def _series(s: Series, x: NDArray[Any], y: NDArray[Any], across: NDArray[Any], down: NDArray[Any]) -> list[str]:
    good, parts = np.isfinite(y), []
    for part in np.split(np.arange(len(y)), np.flatnonzero(np.diff(good)) + 1):
        if len(part) > 1 and good[part[0]]:
            rows = part[thinned(y[part], MAX_POINTS)]
            at, to = across[rows], down[rows]
            at, to = (np.repeat(at, 2)[1:], np.repeat(to, 2)[:-1]) if s.is_stepped else (at, to)
            corners, fill = zip(at.tolist(), to.tolist(), strict=True), s.colour if s.is_filled else "none"
            parts.append(as_line(corners, s.colour, s.width, "stroke-dasharray:4 5" if s.is_dotted else "", fill))
    if s.has_points:
        # A line of no length with round ends stays round where the picture is stretched.
        look = f"stroke:{s.colour};stroke-width:8;stroke-linecap:round;vector-effect:non-scaling-stroke"
        for i in np.flatnonzero(good):
            tip = tipped(f"{s.name} {y[i]:.4g} at {x[i]:.4g}".strip())
            parts.append(f'<path d="M{across[i]:.1f} {down[i]:.1f}h0" style="{look}"{tip}/>')
    return parts


def nice_ticks(low: float, high: float, n: int = 5) -> list[float]:
    """About ``n`` round numbers from low to high, at least two."""
    raw = max(high - low, 1e-12) / n
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(next(s for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= raw * (1.0 - 1e-9)) * power)
    ticks = (np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0) * step + 0.0).tolist()
    return ticks if len(ticks) >= 2 or n > 8 else nice_ticks(low, high, n + 1)


def thinned(signal: NDArray[np.float64], at_most: int) -> NDArray[np.intp]:
    """Rows of a long signal to draw: the smallest and the largest of each of ``at_most``/2 equal stretches.

    All rows if there are fewer; the first and the last are always among them. ``signal`` is finite, shape (n,).
    """
    n = len(signal)
    if n <= at_most:
        return np.arange(n)
    edges = np.linspace(0, n, at_most // 2, dtype=np.intp)
    peaks = [int(a + f) for a, b in pairwise(edges) for f in (signal[a:b].argmin(), signal[a:b].argmax())]
    return np.unique([0, *peaks, n - 1])
