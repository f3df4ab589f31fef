"""Figures of the scored page, as plotly divs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from diagnosis.report.figures import BLUE, GREEN, GREY, RED, div

SIZE_OF_ROW: Final = 22


def confusion(counts: dict[str, dict[str, int]]) -> str:
    """Hidden against said."""
    from plotly import graph_objects as go

    if not counts:
        return "<p>No case with at most one effect.</p>"
    last = ("several", "unknown", "none", "no verdict")
    rows = sorted(counts, key=lambda r: (r in ("none", "never had"), "(left out)" in r, r))
    said = {s for row in counts.values() for s in row}
    columns = sorted(said - set(last)) + [c for c in last if c in said]
    z = [[counts[r].get(c, 0) or None for c in columns] for r in rows]
    text = [["" if n is None else str(n) for n in row] for row in z]
    figure = go.Figure(
        go.Heatmap(
            z=z,
            x=columns,
            y=rows,
            text=text,
            texttemplate="%{text}",
            colorscale="Blues",
            showscale=False,
            xgap=1,
            ygap=1,
            zmin=0,
        )
    )
    figure.update_yaxes(autorange="reversed", title="hidden", automargin=True, dtick=1)
    figure.update_xaxes(tickangle=60, title="said", automargin=True, dtick=1)
    return div(figure, 190 + SIZE_OF_ROW * len(rows))


def reliability(bins: Sequence[dict[str, Any]]) -> str:
    """Stated probability against how often it was so, with bounds."""
    from plotly import graph_objects as go

    figure = go.Figure()
    figure.add_scatter(x=[0, 1], y=[0, 1], mode="lines", line={"color": GREY, "dash": "dot"}, name="calibrated")
    figure.add_scatter(
        x=[b["said"] for b in bins],
        y=[b["value"] for b in bins],
        mode="markers+lines",
        line={"color": BLUE},
        name="verdicts",
        text=[f"{b['hits']} of {b['trials']}" for b in bins],
        hovertemplate="%{x:.2f}: %{y:.2f}, %{text}",
        error_y={
            "type": "data",
            "symmetric": False,
            "array": [b["high"] - b["value"] for b in bins],
            "arrayminus": [b["value"] - b["low"] for b in bins],
        },
    )
    figure.update_xaxes(title="stated probability", range=[-0.02, 1.02])
    figure.update_yaxes(title="share that was so", range=[-0.02, 1.02])
    return div(figure, 380)


def power_curve(points: Sequence[dict[str, Any]]) -> str:
    """Over the ladder: noticed at all, and named."""
    from plotly import graph_objects as go

    figure = go.Figure()
    for key, name, colour, shift in (("noticed", "not called none", GREY, -0.005), ("named", "named", GREEN, 0.005)):
        shares = [p[key] for p in points]
        figure.add_scatter(
            x=[p["size"] + shift for p in points],
            y=[s["value"] for s in shares],
            mode="markers+lines",
            name=name,
            line={"color": colour},
            text=[f"{s['hits']} of {s['trials']}" for s in shares],
            hovertemplate="%{y:.2f}, %{text}",
            error_y={
                "type": "data",
                "symmetric": False,
                "array": [s["high"] - s["value"] for s in shares],
                "arrayminus": [s["value"] - s["low"] for s in shares],
            },
        )
    figure.update_xaxes(title="size, share of the realistic range", range=[0, 1.05])
    figure.update_yaxes(title="share of cases", range=[-0.02, 1.02])
    return div(figure, 380)


def breakdown(cuts: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Shares by cut, one bar each, with bounds."""
    from plotly import graph_objects as go

    bars = [(f"{cut}: {value}", share) for cut, values in cuts.items() for value, share in values.items()]
    bars.reverse()
    figure = go.Figure(
        go.Bar(
            y=[name for name, _ in bars],
            x=[s["value"] for _, s in bars],
            orientation="h",
            marker={"color": [GREEN if s["value"] >= 0.9 else BLUE if s["value"] >= 0.5 else RED for _, s in bars]},
            text=[f"{s['hits']}/{s['trials']}" for _, s in bars],
            textposition="inside",
            insidetextanchor="start",
            error_x={
                "type": "data",
                "symmetric": False,
                "array": [s["high"] - s["value"] for _, s in bars],
                "arrayminus": [s["value"] - s["low"] for _, s in bars],
                "color": GREY,
            },
        )
    )
    figure.update_xaxes(range=[0, 1.02], title="share")
    figure.update_yaxes(automargin=True, dtick=1)
    figure.update_layout(showlegend=False)
    return div(figure, 90 + SIZE_OF_ROW * len(bars))
