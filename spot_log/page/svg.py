"""The few pieces of SVG that the figures are made of. Text is escaped here and nowhere else."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spot_model.text import plain_lines


def esc(text: object) -> str:
    """Text for HTML or an attribute, without what a reader cannot see."""
    return html.escape(plain_lines(str(text)), quote=True)


def svg(width: float, height: float, parts: Iterable[str], label: str) -> str:
    """A picture that scales to the width of its place; ``label`` is for those who cannot see it."""
    look = f'style="--width:{width:g}px" role="img" aria-label="{esc(label)}"'
    return f'<svg viewBox="0 0 {width:g} {height:g}" {look}>{"".join(parts)}</svg>'


def wide(height: float, parts: Iterable[str], label: str, *, left: float = 0, right: float = 0) -> str:
    """A picture as wide as its place and ``height`` pixels high, in which words keep their size.

    The origin lies ``left`` pixels from its left edge. Places across are pixels from there, or percent of the width
    between the margins.
    """
    look = f'class="wide" style="height:{height:g}px;padding:0 {right:g}px 0 {left:g}px" role="img"'
    return f'<svg {look} aria-label="{esc(label)}">{"".join(parts)}</svg>'


def stretched(top: float, height: float, parts: Iterable[str], view: str) -> str:
    """Content of a ``view`` box, stretched over the width between the margins of a :func:`wide` picture."""
    look = f'class="plot" viewBox="{view}" preserveAspectRatio="none" width="100%" height="{height:g}"'
    return f'<svg y="{top:g}" {look}>{"".join(parts)}</svg>'


def placed(x_percent: float, y: float, part: str) -> str:
    """A part of a :func:`wide` picture that is drawn around the origin, at a place across in percent."""
    return f'<svg x="{x_percent:.2f}%" y="{y:g}" width="1" height="1">{part}</svg>'


def dot(x: float, y: float, radius: float, fill: str, tip: str = "") -> str:
    """A disc that stays round where the picture is stretched: a line of no length with round ends."""
    told = f' data-t="{esc(tip)}"' if tip else ""
    look = f"fill:none;stroke:{fill};stroke-width:{2.0 * radius:g};stroke-linecap:round"
    return f'<path d="M{x:.1f} {y:.1f}h0" style="{look}"{told}/>'


def text(
    x: float | str,
    y: float,
    words: object,
    *,
    size: float = 13,
    anchor: str = "start",
    css: str = "",
    weight: int = 400,
    fill: str = "",
) -> str:
    """Words at their baseline; ``x`` may be a percentage, such as "50%"."""
    style = f' style="fill:{fill}"' if fill else ""
    kind = f' class="{css}"' if css else ""
    look = f'font-size="{size:g}" text-anchor="{anchor}" font-weight="{weight}"{kind}{style}'
    across = x if isinstance(x, str) else f"{x:.1f}"
    return f'<text x="{across}" y="{y:.1f}" {look}>{esc(words)}</text>'


def rect(x: float, y: float, width: float, height: float, fill: str, tip: str = "", radius: float = 2) -> str:
    """A box; ``fill`` is a colour or a variable of the style."""
    told = f' data-t="{esc(tip)}"' if tip else ""
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 0.0):.1f}" height="{max(height, 0.0):.1f}" rx="{radius:g}" '
        f'style="fill:{fill}"{told}/>'
    )


def line(points: Sequence[tuple[float, float]], stroke: str, width: float = 1.5, more: str = "") -> str:
    """An open line."""
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return (
        f'<polyline points="{way}" style="fill:none;stroke:{stroke};stroke-width:{width:g};'
        f'stroke-linejoin:round;stroke-linecap:round;{more}"/>'
    )


def disc(x: float, y: float, radius: float, fill: str, tip: str = "", stroke: str = "", width: float = 0.0) -> str:
    """A circle."""
    told = f' data-t="{esc(tip)}"' if tip else ""
    edge = f";stroke:{stroke};stroke-width:{width:g}" if stroke else ""
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" style="fill:{fill}{edge}"{told}/>'


def legend(entries: Iterable[tuple[str, str]]) -> str:
    """Colours and what they mean, as HTML."""
    return (
        "<p class='legend'>"
        + "".join(f"<span><i style='background:{colour}'></i>{esc(words)}</span>" for colour, words in entries)
        + "</p>"
    )


def nice_ticks(low: float, high: float, n: int = 5) -> list[float]:
    """About ``n`` round numbers from low to high, at least two."""
    span = max(high - low, 1e-12)
    raw = span / max(n, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = float(min((s for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= raw), default=10.0) * power)
    first = float(np.ceil(low / step - 1e-9)) * step
    ticks = [first + i * step for i in range(int((high - first) / step + 1e-9) + 1)]
    return ticks if len(ticks) >= 2 or n > 8 else nice_ticks(low, high, n + 1)


def rounded(value: float) -> str:
    """Four digits, without an exponent where a person expects none."""
    return f"{float(f'{value:.4g}'):g}"


def thinned(values: ArrayLike, at_most: int) -> NDArray[np.intp]:
    """Rows of a long signal to draw: the smallest and the largest of each of ``at_most``/2 equal stretches.

    Args:
        values: Signal, shape (n,); NaN is never chosen as a peak.
        at_most: How many rows, >= 4.

    Returns:
        Rising row numbers, all of them if there are fewer; the first and the last are always among them.
    """
    signal = np.asarray(values, dtype=np.float64)
    n = len(signal)
    if n <= at_most:
        return np.arange(n)
    edges = np.linspace(0, n, at_most // 2, dtype=np.intp)
    low, high = np.where(np.isnan(signal), np.inf, signal), np.where(np.isnan(signal), -np.inf, signal)
    peaks = [int(a + f) for a, b in pairwise(edges) for f in (low[a:b].argmin(), high[a:b].argmax())]
    return np.unique([0, *peaks, n - 1])


def liveliest(sizes: ArrayLike, length: int) -> slice:
    """The stretch of ``length`` rows, at least one, in which ``sizes``, shape (n,), sum up to most; NaN counts as 0."""
    sums = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.asarray(sizes, dtype=np.float64)))])
    length = max(1, min(length, len(sums) - 1))
    start = int(np.argmax(sums[length:] - sums[:-length]))
    return slice(start, start + length)


HEAT = ((255, 246, 219), (254, 217, 118), (253, 141, 60), (227, 26, 28), (128, 0, 38))
"""Pale to dark red."""


def heat(share: float) -> str:
    """A colour of the scale, share 0 to 1."""
    at = min(max(share, 0.0), 1.0) * (len(HEAT) - 1)
    i = min(int(at), len(HEAT) - 2)
    mixed = [round(a + (b - a) * (at - i)) for a, b in zip(HEAT[i], HEAT[i + 1], strict=True)]
    return "#" + "".join(f"{c:02x}" for c in mixed)


def on_heat(share: float) -> str:
    """A colour of words that can be read on it."""
    return "#ffffff" if share > 0.62 else "#1d2730"


WIDE: Final = 1160
HALF: Final = 560
QUARTER: Final = 284
"""Widths of a chart that fills the page, a half and a quarter of it."""
_RIGHT: Final = 12
_BELOW: Final = 24


@dataclass(frozen=True)
class Frame:
    """A rectangle of data and the rectangle of the picture that shows it."""

    x: tuple[float, float]
    """What the left and the right edge stand for."""
    y: tuple[float, float]
    """What the lower and the upper edge stand for."""
    width: float
    """Width of the picture, with its labels."""
    height: float
    """Height of the plot."""
    left: float = 62
    top: float = 8

    @property
    def right(self) -> float:
        """Right edge of the plot."""
        return self.width - _RIGHT

    @property
    def total_height(self) -> float:
        """Height of plot and labels, without the axis' title."""
        return self.top + self.height + _BELOW

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a point of the data lies in the picture."""
        first, last = self.x
        low, high = self.y
        across = (x - first) / max(last - first, 1e-9) * (self.right - self.left)
        return self.left + across, self.top + self.height * (high - y) / max(high - low, 1e-12)

    def grid(self) -> list[str]:
        """Lines at round numbers of the vertical axis."""
        ys = (self.at(0.0, tick)[1] for tick in nice_ticks(*self.y, 4))
        return [line([(self.left, y), (self.right, y)], "var(--line)", 1) for y in ys]

    def heights(self) -> list[str]:
        """The numbers of the vertical axis, left of the plot."""
        ticks = nice_ticks(*self.y, 4)
        at = ((tick, self.at(0.0, tick)[1] + 4) for tick in ticks)
        return [text(-8, y, f"{tick:g}", size=12, anchor="end", css="soft") for tick, y in at]

    def across(self, unit: str = "", title: str = "") -> list[str]:
        """The numbers of the horizontal axis and its title, below the plot; half of many go on a narrow screen."""
        ticks = nice_ticks(*self.x, 8 if self.width > 700 else 5 if self.width > 400 else 3)
        parts, y = [], self.top + self.height + 16
        for i, tick in enumerate(ticks):
            at = 100.0 * (self.at(tick, 0.0)[0] - self.left) / (self.right - self.left)
            css = "soft few" if i % 2 and len(ticks) > 6 else "soft"
            parts.append(text(f"{at:.2f}%", y, f"{tick:g}{unit}", size=12, anchor="middle", css=css))
        if title:
            parts.append(text("50%", y + 20, title, size=12.5, anchor="middle", css="soft"))
        return parts

    def plot(self, parts: Iterable[str]) -> str:
        """What lies in the plot: places from :meth:`at`."""
        view = f"{self.left:g} {self.top:g} {self.right - self.left:g} {self.height:g}"
        return stretched(self.top, self.height, parts, view)

    def picture(self, height: float, parts: Iterable[str], label: str) -> str:
        """The whole, with the frame's margins."""
        return wide(height, parts, label, left=self.left, right=_RIGHT)
