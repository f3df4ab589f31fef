"""A chart that stands by itself, for notebooks and files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from spot_log.page.draw import RIGHT, drawn, words
from spot_log.page.sections import Chart, Series

COLOURS: Final = ("#2f6fb5", "#c8402f", "#1f8a5b", "#8446a8")
_LEGEND_PX: Final = 24


class Picture(NamedTuple):
    """A picture that a notebook shows, and that can be saved: an SVG document."""

    svg: str

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
    found = [Series(c, v.index.to_numpy(), v.to_numpy()) for c, v in zip(COLOURS, lines.values(), strict=False)]
    looks = zip(lines, COLOURS, range(62, width, 180), strict=False)
    names = [words(x, 14, name, anchor="start", more=f' style="fill:{colour}"') for name, colour, x in looks]
    return Picture(standing(Chart(found, y_title, x_unit=" s", height=height), width, names))


def standing(chart: Chart, width: int, names: Sequence[str] = ()) -> str:
    """A chart with a size of its own on white, below its legend. Raises ValueError: it has no finite value."""
    left, height, inside = drawn(chart, 8 if width > 700 else 5)
    if not inside:
        raise ValueError("nothing to draw, no value is finite")
    place = f'x="{left}" y="{_LEGEND_PX}" width="{width - left - RIGHT}" height="{height:g}" overflow="visible"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height + _LEGEND_PX:g}" color="#1d2730" '
        f'font-family="system-ui,sans-serif"><rect width="100%" height="100%" fill="#fff"/>{"".join(names)}'
        f"<svg {place}>{inside}</svg></svg>"
    )
