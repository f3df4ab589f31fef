"""Plots of a run's page with plotly: one look, thinned lines, histograms with their percentiles, bars of stance."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from spot_log.page.cells import Html, note

MEASURED: Final = "#1f6fb2"
ASKED: Final = "#d1662b"
LIMIT: Final = "#b03030"
NEUTRAL: Final = "#7a8794"
FEET: Final = ("#1f6fb2", "#d1662b", "#3c8d5a", "#8e5aa8")
"""Colours of what was measured, of what was asked for, of limits, of all else, and of the feet fl, fr, hl, hr."""

_BUTTONS: Final = [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "autoScale2d", "resetScale2d"]]
_CONFIG: Final = {"displaylogo": False, "responsive": True, "modeBarButtons": _BUTTONS}
MAX_POINTS: Final = 1600
MAX_STANCES: Final = 4000


def plot(figure: Any, name: str) -> Html:
    """A plotly figure as a part of a page, or a word where it is None."""
    if figure is None:
        return note("The log has no data for this.")
    return Html(figure.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure-{name}", config=_CONFIG))


def styled(figure: Any, height: int, *, legend: bool = True, title: str = "", x: str = "", y: str = "") -> Any:
    """The same figure in the look of all pages; ``x`` and ``y`` name its axes."""
    figure.update_layout(
        height=height,
        margin={"l": 62, "r": 18, "t": 56, "b": 44},
        showlegend=legend,
        template="plotly_white",
        hovermode="x",
        bargap=0,
        font={"family": "system-ui, sans-serif", "size": 12, "color": "#26313b"},
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1 + 22 / (height - 90), "yanchor": "bottom"},
    )
    if title:
        figure.update_layout(title={"text": title, "font": {"size": 14}})
    if x or y:
        figure.update_layout(xaxis_title=x, yaxis_title=y)
    figure.update_annotations(font_size=12)
    return figure


def line(
    figure: go.Figure,
    time_s: NDArray[Any],
    values: NDArray[Any],
    name: str,
    color: str,
    *,
    row: int = 1,
    col: int = 1,
    first: bool = True,
    step: bool = False,
    width: float = 1.3,
    points: int = MAX_POINTS,
) -> None:
    """Draw a signal with at most ``points`` points; only the ``first`` of a name stands in the legend."""
    rows = thin_rows(values, points)
    trace = go.Scatter(
        x=time_s[rows].astype(np.float32),
        y=values[rows].astype(np.float32),
        mode="lines",
        name=name,
        legendgroup=name,
        showlegend=first,
        line={"color": color, "width": width, "shape": "hv" if step else "linear"},
    )
    figure.add_trace(trace, row=row, col=col)


def histogram(figure: go.Figure, values: NDArray[Any], col: int) -> None:
    """Draw a histogram with its median and 99th percentile; what lies beyond the 99.5th is counted in words."""
    if not len(values):
        figure.add_annotation(text="not known", showarrow=False, x=0.5, y=0.5, row=1, col=col)
        return
    top = float(np.percentile(values, 99.5))
    low = float(values.min())
    counts, edges = np.histogram(values, bins=40, range=(low, top if top > low else low + 1.0))
    beyond = int(np.sum(values > edges[-1]))
    middles = 0.5 * (edges[:-1] + edges[1:])
    figure.add_trace(
        go.Bar(x=middles, y=counts, marker_color=MEASURED, width=float(edges[1] - edges[0]), showlegend=False),
        row=1,
        col=col,
    )
    for share, label in ((50, "p50"), (99, "p99")):
        at = float(np.percentile(values, share))
        figure.add_vline(x=at, line={"color": ASKED, "width": 1.5, "dash": "dot"}, row=1, col=col)
        figure.add_annotation(
            x=at,
            y=1.0 if share == 50 else 0.86,
            yref="y domain",
            text=f"{label} {at:.4g}",
            showarrow=False,
            xanchor="left" if share == 50 else "right",
            font={"size": 11, "color": ASKED},
            row=1,
            col=col,
        )
    if beyond:
        text = f"{beyond} more, up to {values.max():.4g}"
        figure.add_annotation(
            x=1,
            y=0.7,
            xref="x domain",
            yref="y domain",
            text=text,
            showarrow=False,
            xanchor="right",
            font={"size": 11, "color": NEUTRAL},
            row=1,
            col=col,
        )


def stance_diagram(time_s: NDArray[Any], contact: NDArray[np.bool_], names: Sequence[str]) -> go.Figure:
    """A gait diagram: a bar for each foot while it is on the ground.

    Args:
        time_s: Shape (n,).
        contact: Shape (n, n_feet).
        names: Of the feet.
    """
    figure = go.Figure()
    for foot, name in enumerate(names):
        x, y = _bars(time_s, contact[:, foot], foot)
        bar = {"width": 20, "color": FEET[foot % len(FEET)]}
        figure.add_trace(go.Scatter(x=x, y=y, mode="lines", line=bar, name=name, hoverinfo="x+name"))
    ticks = {"tickvals": list(range(len(names))), "ticktext": list(names), "ticklabelstandoff": 8}
    figure.update_yaxes(range=[len(names) - 0.5, -0.5], showgrid=False, **ticks)
    figure.update_xaxes(title_text="time, s")
    return styled(figure, 60 * len(names) + 90, legend=False)


def _bars(time_s: NDArray[Any], mask: NDArray[np.bool_], level: int) -> tuple[list[float | None], list[int | None]]:
    """Thick line segments where the mask holds, at a height, with breaks between."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    x: list[float | None] = []
    y: list[int | None] = []
    for a, b in zip(edges[::2][:MAX_STANCES], edges[1::2][:MAX_STANCES], strict=True):
        x += [round(float(time_s[a]), 3), round(float(time_s[b - 1]), 3), None]
        y += [level, level, None]
    return x, y


def thin_rows(values: NDArray[Any], max_points: int) -> NDArray[np.int64]:
    """Choose rows of a signal to draw: the smallest and the largest of each of ``max_points``/2 equal stretches.

    Args:
        values: Signal, shape (n,); NaN is never chosen as a peak.
        max_points: How many rows at most, >= 4.

    Returns:
        Rising row numbers, at most ``max_points``; all rows where there are no more, first and last always among them.
    """
    n = len(values)
    if n <= max_points:
        return np.arange(n)
    edges = np.linspace(0, n, max_points // 2, dtype=np.int64)
    low = np.where(np.isnan(values), np.inf, values)
    high = np.where(np.isnan(values), -np.inf, values)
    rows = [0, n - 1]
    for a, b in pairwise(edges):
        rows += [int(a + low[a:b].argmin()), int(a + high[a:b].argmax())]
    return np.unique(rows)
