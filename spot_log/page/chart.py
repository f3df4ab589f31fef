"""Lines and points on two axes, as SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from spot_log.page.svg import disc, line, nice_ticks, rect, svg, text, thinned

WIDE: Final = 1160
HALF: Final = 560
MAX_POINTS: Final = 600
_LEFT: Final = 62
_RIGHT: Final = 12
_TOP: Final = 8.0

At = Callable[[float, float], tuple[float, float]]
"""Where a point of the axes lies in the picture."""


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
    has_points: bool = False
    name: str = ""
    """For the tips of points."""


@dataclass(frozen=True)
class Shade:
    """A stretch of the horizontal axis."""

    start: float
    end: float
    tip: str


def chart(
    lines: Sequence[Series],
    y_title: str,
    *,
    x_title: str = "",
    x_unit: str = "",
    width: float = WIDE,
    height: float = 190,
    shades: Sequence[Shade] = (),
    zero: bool = False,
) -> str:
    """Draw lines on common axes; an empty text where nothing is finite.

    Args:
        lines: What to draw; later ones lie on top.
        y_title: Of the vertical axis, with its unit.
        x_title: Below the horizontal axis.
        x_unit: Behind each of its numbers.
        width: Of the picture.
        height: Of the plot.
        shades: Stretches behind the lines.
        zero: Whether the vertical axis begins at 0.
    """
    drawn = [(s, np.asarray(s.x, dtype=np.float64), np.asarray(s.y, dtype=np.float64)) for s in lines]
    drawn = [(s, x, y) for s, x, y in drawn if np.isfinite(y).any()]
    if not drawn:
        return ""
    low, high = (float(f([f(y[np.isfinite(y)]) for _, _, y in drawn])) for f in (np.min, np.max))
    pad = 0.06 * max(high - low, 1e-6)
    low, high = (0.0 if zero else low - pad), high + pad
    first, last = min(float(x.min()) for _, x, _ in drawn), max(float(x.max()) for _, x, _ in drawn)
    span = max(last - first, 1e-9)

    def at(x: float, y: float) -> tuple[float, float]:
        return (
            _LEFT + (x - first) / span * (width - _LEFT - _RIGHT),
            _TOP + height * (high - y) / (high - low),
        )

    parts = [_shade(s, at(s.start, high), at(s.end, low)) for s in shades]
    parts += _axes(at, (first, last), (low, high), width, height, x_unit)
    for s, x, y in drawn:
        parts += _drawn(s, x, y, at)
    name = text(0, 0, y_title, size=12.5, anchor="middle")
    parts.append(f'<g transform="translate(14 {_TOP + height / 2:.0f}) rotate(-90)">{name}</g>')
    bottom = _TOP + height + 24
    if x_title:
        parts.append(text((width + _LEFT) / 2, bottom + 12, x_title, size=12.5, anchor="middle", css="soft"))
        bottom += 20
    return svg(width, bottom, parts, f"{y_title} over {x_title or 'time'}")


def stance(contact: ArrayLike, names: Sequence[str], colour: str, *, width: float = WIDE) -> str:
    """Feet on the ground over a stretch of time, one row a foot.

    Args:
        contact: Whether each foot is down, samples at even times. Shape (n, feet).
        names: Of the feet.
        colour: Of the bars.
        width: Of the picture.
    """
    down = np.asarray(contact, dtype=np.bool_)
    if down.ndim != 2 or down.shape[1] != len(names) or not len(down):
        return ""
    row, scale = 18, (width - _LEFT - _RIGHT) / len(down)
    parts = []
    for foot, name in enumerate(names):
        y = 4 + row * foot
        parts.append(text(_LEFT - 8, y + 12, name, size=12, anchor="end"))
        parts.append(rect(_LEFT, y, width - _LEFT - _RIGHT, row - 4, "var(--empty)", radius=0))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], down[:, foot].astype(int), [0]])))
        parts += [
            rect(_LEFT + scale * a, y, scale * (b - a), row - 4, colour, f"{name} on the ground", radius=0)
            for a, b in edges.reshape(-1, 2)
        ]
    return svg(width, 4 + row * len(names), parts, "Feet on the ground")


def _shade(s: Shade, upper: tuple[float, float], lower: tuple[float, float]) -> str:
    return rect(upper[0], upper[1], lower[0] - upper[0], lower[1] - upper[1], "var(--cause)", s.tip, radius=0)


def _axes(
    at: At, x_range: tuple[float, float], y_range: tuple[float, float], width: float, height: float, x_unit: str
) -> list[str]:
    parts = []
    for tick in nice_ticks(*y_range, 4):
        y = at(x_range[0], tick)[1]
        parts.append(line([(_LEFT, y), (width - _RIGHT, y)], "var(--line)", 1))
        parts.append(text(_LEFT - 8, y + 4, f"{tick:g}", size=12, anchor="end", css="soft"))
    for tick in nice_ticks(*x_range, 8 if width > 700 else 5):
        words = f"{tick:g}{x_unit}"
        parts.append(text(at(tick, y_range[0])[0], _TOP + height + 16, words, size=12, anchor="middle", css="soft"))
    return parts


def _drawn(s: Series, x: np.ndarray, y: np.ndarray, at: At) -> list[str]:
    rows = thinned(x, MAX_POINTS)
    good = np.isfinite(y[rows])
    parts = []
    for part in np.split(rows, np.flatnonzero(np.diff(good.astype(int))) + 1):
        if len(part) > 1 and np.isfinite(y[part]).all():
            points = [at(float(a), float(b)) for a, b in zip(x[part], y[part], strict=True)]
            parts.append(line(points, s.colour, s.width, "stroke-dasharray:4 5;" if s.is_dotted else ""))
    if s.has_points:
        parts += [
            disc(*at(float(a), float(b)), 4, s.colour, f"{s.name} {b:.4g} at {a:.4g}".strip())
            for a, b in zip(x[rows][good], y[rows][good], strict=True)
        ]
    return parts
