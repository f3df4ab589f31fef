"""A chart that stands by itself, for notebooks and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from spot_log.page.chart import Series, chart
from spot_log.page.svg import text

COLOURS: Final = ("#2f6fb5", "#c8402f", "#1f8a5b", "#8446a8")
_STYLE: Final = (
    "<style>text{fill:#1d2730;font-family:system-ui,sans-serif}.soft{fill:#5c6b78}"
    ".grid{stroke:#dbe2e8;stroke-width:1;fill:none}</style>"
)
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
    inner = body[body.index(">") + 1 : body.rindex("</svg>")]
    bottom = float(body.split('viewBox="0 0 ')[1].split('"')[0].split()[1])
    names = [text(62 + 180 * i, 14, name, size=12.5, fill=colour) for i, ((name, _), colour) in enumerate(coloured)]
    size = f'width="{width}" height="{bottom + _TOP:g}" viewBox="0 0 {width} {bottom + _TOP:g}"'
    return Picture(
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{_STYLE}<rect width="100%" height="100%" fill="#fff"/>'
        f'{"".join(names)}<g transform="translate(0 {_TOP})">{inner}</g></svg>'
    )
