"""The axes of a chart, as SVG: where a point lies, round numbers, and titles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from spot_log.page.svg import line, nice_ticks, text

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
