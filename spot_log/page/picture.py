"""A chart that stands by itself, for notebooks and files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from spot_log.page.chart import Series, chart
from spot_log.page.svg import text

COLOURS: Final = ("#2f6fb5", "#c8402f", "#1f8a5b", "#8446a8")
_STYLE: Final = (
    "<style>svg{--line:#dbe2e8}text{fill:#1d2730;font-family:system-ui,sans-serif}.soft{fill:#5c6b78}</style>"
)
_MARGINS: Final = re.compile(r'style="height:([\d.]+)px;padding:0 ([\d.]+)px 0 ([\d.]+)px"')
_TOP: Final = 24


@dataclass(frozen=True)
class Picture:
    """A picture that a notebook shows, and that can be saved."""

    svg: str
    """An SVG document."""

    def _repr_svg_(self) -> str:
        return self.svg


def plot(lines: Mapping[str, Any], y_title: str, *, width: int = 760, height: int = 190) -> Picture:
    """Draw up to four columns of a run's data frames over time, on white.

    Args:
        lines: A ``pandas.Series`` by its name in the legend, indexed by seconds.
        y_title: Beside the vertical axis, with its unit.
        width: Of the picture, pixels.
        height: Of the plot, pixels.

    Raises:
        ValueError: There are more than four lines, or none has a finite value.
    """
    if len(lines) > len(COLOURS):
        raise ValueError(f"{len(lines)} lines: at most {len(COLOURS)} can be told apart")
    coloured = list(zip(lines.items(), COLOURS, strict=False))
    drawn = [Series(colour, values.index.to_numpy(), values.to_numpy()) for (_, values), colour in coloured]
    body = chart(drawn, y_title, x_unit=" s", width=width, height=height)
    if not body:
        raise ValueError(f"{', '.join(lines) or 'no line'}: nothing to draw, no value is finite")
    # A chart takes the width of its place, and leaves its margins to the style of a page; here both are fixed.
    tall, right, left = map(float, _MARGINS.findall(body)[0])
    inside = body[body.index(">") + 1 : body.rindex("</svg>")]
    names = [text(left + 180 * i, 14, name, size=12.5, fill=colour) for i, ((name, _), colour) in enumerate(coloured)]
    size = f'width="{width}" height="{tall + _TOP:g}" viewBox="0 0 {width} {tall + _TOP:g}"'
    place = f'x="{left:g}" y="{_TOP}" width="{width - left - right:g}" height="{tall:g}" overflow="visible"'
    return Picture(
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{_STYLE}<rect width="100%" height="100%" fill="#fff"/>'
        f"{''.join(names)}<svg {place}>{inside}</svg></svg>"
    )
