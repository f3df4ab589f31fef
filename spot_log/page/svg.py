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


def text(
    x: float,
    y: float,
    words: object,
    *,
    size: float = 13,
    anchor: str = "start",
    css: str = "",
    weight: int = 400,
    fill: str = "",
) -> str:
    """Words at their baseline."""
    style = f' style="fill:{fill}"' if fill else ""
    kind = f' class="{css}"' if css else ""
    look = f'font-size="{size:g}" text-anchor="{anchor}" font-weight="{weight}"{kind}{style}'
    return f'<text x="{x:.1f}" y="{y:.1f}" {look}>{esc(words)}</text>'


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
    """Of the picture, with its labels."""
    height: float
    """Of the plot."""
    left: float = 62
    top: float = 8

    @property
    def right(self) -> float:
        """Right edge of the plot."""
        return self.width - _RIGHT

    @property
    def total_height(self) -> float:
        """Of plot and labels, without the axis' title."""
        return self.top + self.height + _BELOW

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a point of the data lies in the picture."""
        first, last = self.x
        low, high = self.y
        across = (x - first) / max(last - first, 1e-9) * (self.right - self.left)
        return self.left + across, self.top + self.height * (high - y) / max(high - low, 1e-12)

    def axes(self, *, x_unit: str = "", has_y: bool = True) -> list[str]:
        """Lines at round numbers, and the numbers."""
        parts = []
        for tick in nice_ticks(*self.y, 4) if has_y else []:
            y = self.at(0.0, tick)[1]
            parts.append(line([(self.left, y), (self.right, y)], "var(--line)", 1))
            parts.append(text(self.left - 8, y + 4, f"{tick:g}", size=12, anchor="end", css="soft"))
        for tick in nice_ticks(*self.x, 8 if self.width > 700 else 5 if self.width > 400 else 3):
            x = self.at(tick, 0.0)[0]
            words = f"{tick:g}{x_unit}"
            parts.append(text(x, self.top + self.height + 16, words, size=12, anchor="middle", css="soft"))
        return parts
