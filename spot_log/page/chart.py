"""Lines and points on two axes, as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from spot_log.page.svg import QUARTER, WIDE, Frame, dot, line, rect, rounded, text, thinned, wide

MAX_POINTS: Final = 600


@dataclass(frozen=True)
class Series:
    """One line of a chart; where ``y`` is not finite it has a gap."""

    colour: str
    """A colour, or a variable of the style."""
    x: ArrayLike
    """Shape (n,)."""
    y: ArrayLike
    """Shape (n,)."""
    width: float = 1.6
    is_dotted: bool = False
    is_stepped: bool = False
    """Whether each value holds until the next."""
    has_points: bool = False
    name: str = ""
    """For the tips of points."""


@dataclass(frozen=True)
class Shade:
    """A stretch of the horizontal axis."""

    start: float
    end: float
    tip: str
    colour: str = "var(--cause)"


def chart(
    lines: Sequence[Series],
    y_title: str = "",
    *,
    title: str = "",
    x_title: str = "",
    x_unit: str = "",
    width: float = WIDE,
    height: float = 190,
    shades: Sequence[Shade] = (),
    zero: bool = False,
    least_span: float = 0.0,
    y_range: tuple[float, float] | None = None,
) -> str:
    """Draw lines on common axes; an empty text where nothing is finite.

    Args:
        lines: What to draw; later ones lie on top.
        y_title: Beside the vertical axis, with its unit.
        title: Above the plot.
        x_title: Below the horizontal axis.
        x_unit: Behind each of its numbers.
        width: Of the picture.
        height: Of the plot.
        shades: Stretches behind the lines.
        zero: Whether the vertical axis begins at 0.
        least_span: What the vertical axis shows at least.
        y_range: Of the vertical axis, where several charts share it; by default what the lines need.
    """
    drawn = [(s, np.asarray(s.x, dtype=np.float64), np.asarray(s.y, dtype=np.float64)) for s in lines]
    drawn = [(s, x, y) for s, x, y in drawn if np.isfinite(y).any()]
    if not drawn:
        return ""
    low, high = (float(f([f(y[np.isfinite(y)]) for _, _, y in drawn])) for f in (np.min, np.max))
    # A line that hardly moves is no mountain range.
    span = max(high - low, 0.01 * max(abs(low), abs(high)), 1e-6)
    pad = max(0.06 * span, 0.5 * (max(least_span, span) - (high - low)))
    low, high = y_range or ((0.0 if zero else low - pad), high + pad)
    first, last = min(float(x.min()) for _, x, _ in drawn), max(float(x.max()) for _, x, _ in drawn)
    frame = Frame((first, last), (low, high), width, height, left=62 if y_title else 44, top=26 if title else 8)
    inside = [_shade(s, frame) for s in shades] + frame.grid()
    for s, x, y in drawn:
        inside += _drawn(s, x, y, frame)
    parts = [frame.plot(inside), *frame.heights(), *frame.across(x_unit, x_title)]
    if title:
        parts.append(text(0, 16, title, size=13, weight=500))
    if y_title:
        name = text(0, 0, y_title, size=12.5, anchor="middle")
        parts.append(
            f'<g transform="translate({14 - frame.left:g} {frame.top + height / 2:.0f}) rotate(-90)">{name}</g>'
        )
    bottom = frame.total_height + (20 if x_title else 0)
    return frame.picture(bottom, parts, f"{y_title or title} over {x_title or 'time'}")


def _shade(s: Shade, frame: Frame) -> str:
    left, right = (frame.at(min(max(x, frame.x[0]), frame.x[1]), 0.0)[0] for x in (s.start, s.end))
    return rect(left, frame.top, max(right - left, 1.5), frame.height, s.colour, s.tip, radius=0)


def _drawn(s: Series, x: np.ndarray, y: np.ndarray, frame: Frame) -> list[str]:
    rows = thinned(y, MAX_POINTS)
    x, y = x[rows], y[rows]
    good = np.isfinite(y)
    parts = []
    for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(good.astype(int))) + 1):
        if len(part) > 1 and good[part].all():
            points = [frame.at(float(a), float(b)) for a, b in zip(x[part], y[part], strict=True)]
            corners = _stepped(points) if s.is_stepped else points
            parts.append(line(corners, s.colour, s.width, "stroke-dasharray:4 5;" if s.is_dotted else ""))
    if s.has_points:
        parts += [
            dot(*frame.at(float(a), float(b)), 4, s.colour, f"{s.name} {b:.4g} at {a:.4g}".strip())
            for a, b in zip(x[good], y[good], strict=True)
        ]
    return parts


def _stepped(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The corners of a line that holds each height until the next point; level stretches need no points between."""
    corners = [points[0]]
    for x, y in points[1:]:
        if y != corners[-1][1]:
            corners += [(x, corners[-1][1]), (x, y)]
    return [*corners, (points[-1][0], corners[-1][1])]


_BINS: Final = 40
_SHOWN_PERCENT: Final = 99.5


def histogram(values: ArrayLike, title: str, *, width: float = QUARTER, height: float = 150) -> str:
    """Draw how often each value came; what lies beyond the 99.5th percentile is counted in words.

    Args:
        values: Shape (n,); those that are not finite are left out.
        title: What they are, with the unit.
        width: Of the picture.
        height: Of the plot.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return wide(height, [text(4, 16, title, weight=500), text(4, 40, "not known", css="soft")], title)
    low, top = float(known.min()), float(np.percentile(known, _SHOWN_PERCENT))
    counts, edges = np.histogram(known, bins=_BINS, range=(low, top if top > low else low + 1.0))
    frame = Frame((float(edges[0]), float(edges[-1])), (0.0, 1.08 * counts.max()), width, height, left=44, top=58)
    inside = frame.grid()
    for count, a, b in zip(counts, edges[:-1], edges[1:], strict=True):
        (left, y), (right, base) = frame.at(float(a), float(count)), frame.at(float(b), 0.0)
        inside.append(
            rect(
                left, y, right - left, base - y, "var(--floor)", f"{count} from {rounded(a)} to {rounded(b)}", radius=0
            )
        )
    p50, p99 = (float(p) for p in np.percentile(known, [50, 99]))
    for value in (p50, p99):
        x = frame.at(value, 0.0)[0]
        inside.append(line([(x, frame.top), (x, frame.top + height)], "var(--nominal)", 1.5, "stroke-dasharray:3 4;"))
    parts = [text(-40, 16, title, weight=500), frame.plot(inside), *frame.heights(), *frame.across()]
    parts.append(text(-40, 33, f"median {rounded(p50)}, 99 % below {rounded(p99)}", size=12, css="soft"))
    beyond = int(np.sum(known > edges[-1]))
    if beyond:
        parts.append(text(-40, 49, f"{beyond} more, up to {rounded(float(known.max()))}", size=12, css="soft"))
    return frame.picture(frame.total_height, parts, title)
