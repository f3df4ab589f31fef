"""The report's figures, as plotly divs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from diagnosis.logs import policy_ticks
from diagnosis.verdict import GapCell, UnknownEffect, Verdict
from spot_runtime.log.run import Run

BLUE, RED, GREY, GREEN = "#2f6fb5", "#c0392b", "#8a97a3", "#2e8b57"
CONFIG: Final = {"displaylogo": False, "responsive": True}
TRACE_S: Final = (2.0, 4.0)
MAX_POINTS: Final = 700
SIGNALS: Final = ("load error", "load", "velocity", "position")


def div(figure: Any, height: int) -> str:
    """A figure without the library."""
    figure.update_layout(
        template="plotly_white", height=height, margin={"l": 60, "r": 20, "t": 30, "b": 45}, font={"size": 12},
        legend={"orientation": "h", "y": 1.08},
    )  # fmt: skip
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config=CONFIG))


def heat_map(cells: Sequence[GapCell], joints: Sequence[str]) -> str:
    """All cells: joints across, regimes down, one panel a signal."""
    from plotly import graph_objects as go
    from plotly.subplots import make_subplots

    signals = [s for s in SIGNALS if any(c.signal == s for c in cells)]
    regimes = list(dict.fromkeys(c.regime for c in sorted(cells, key=lambda c: c.regime)))
    by_key = {(c.signal, c.regime, c.joint): c for c in cells}
    figure = make_subplots(
        rows=1, cols=len(signals), subplot_titles=signals, shared_yaxes=True, horizontal_spacing=0.015
    )
    has_floor = any(c.ratio is not None for c in cells)
    for k, signal in enumerate(signals):
        z, text = [], []
        largest = max((c.gap for c in cells if c.signal == signal), default=1.0)
        for regime in regimes:
            row = [by_key.get((signal, regime, joint)) for joint in joints]
            z.append([None if c is None else _shade(c, largest) for c in row])
            text.append(["" if c is None else _hover(c) for c in row])
        figure.add_trace(
            go.Heatmap(
                z=z, x=list(joints), y=regimes, text=text, hoverinfo="text", colorscale="YlOrRd", zmin=0,
                zmax=np.log2(16) if has_floor else 1, showscale=k == len(signals) - 1,
                colorbar={"title": "gap / floor", "tickvals": [0, 1, 2, 3, 4], "ticktext": ["1", "2", "4", "8", "16"]}
                if has_floor else {"title": "gap / largest"},
            ), row=1, col=k + 1,
        )  # fmt: skip
    figure.update_xaxes(tickangle=90)
    return div(figure, 560)


def _shade(cell: GapCell, largest: float) -> float:
    return float(np.log2(max(cell.ratio, 1.0))) if cell.ratio is not None else cell.gap / max(largest, 1e-12)


def _hover(c: GapCell) -> str:
    end = f"<br>floor {c.floor:.3g} {c.unit}, ratio {c.ratio:.2f}" if c.ratio is not None else ""
    end += f"<br>p {c.p_value:.3f}" if c.p_value is not None else ""
    end += f"<br>90 % interval {c.low:.3g} to {c.high:.3g}" if c.low is not None and c.high is not None else ""
    return f"{c.signal}, {c.joint}<br>{c.regime}<br>gap {c.gap:.3g} {c.unit}{end}<br>{c.n_samples} samples"


def ranking(verdict: Verdict) -> str:
    """Probabilities of effects, none and unknown."""
    from plotly import graph_objects as go

    rows: dict[str, float] = {}
    for effect in verdict.effects:
        for name, p in effect.rivals.items():
            rows[name] = max(rows.get(name, 0.0), p)
    names = sorted(rows, key=lambda n: -rows[n])[:10]
    chosen = {e.name for e in verdict.effects}
    grouped = {m for e in verdict.effects for m in e.group}
    bars = [(n, rows[n], RED if n in chosen else "#e59866" if n in grouped else GREY) for n in names]
    bars += [("none", verdict.probability_none, BLUE), ("unknown", verdict.probability_unknown, "#7d3c98")]
    bars.reverse()
    figure = go.Figure(go.Bar(
        x=[b[1] for b in bars], y=[b[0] for b in bars], orientation="h", marker={"color": [b[2] for b in bars]},
        text=[f"{b[1]:.2f}" for b in bars], textposition="outside", cliponaxis=False,
    ))  # fmt: skip
    figure.update_xaxes(range=[0, 1.08], title="probability")
    figure.update_layout(showlegend=False)
    return div(figure, 70 + 26 * len(bars))


def shrink_bars(verdict: Verdict) -> str:
    """Before, after and floor of each measure."""
    from plotly import graph_objects as go

    s = verdict.shrink
    if s is None:
        return ""
    rows: list[tuple[str, tuple[float, float, float]]] = [("W1 + MMD (floor = 1)", (s.d0, s.d1, s.floor))] + [
        (f"{o.name}, {o.unit}", (o.before, o.after, o.floor)) for o in s.beside
    ]
    figure = go.Figure()
    for i, (title, colour) in enumerate((("nominal", GREY), ("corrected", GREEN), ("real against real", BLUE))):
        figure.add_bar(
            name=title, x=[r[0] for r in rows], y=[r[1][i] / max(r[1][0], 1e-12) for r in rows], marker_color=colour,
            text=[f"{r[1][i]:.3g}" for r in rows], textposition="outside", cliponaxis=False,
        )  # fmt: skip
    figure.update_yaxes(title="share of the gap before", rangemode="tozero")
    return div(figure, 330)


def traces(real: Run, nominal: Run | None, corrected: Run | None, joint: int) -> str:
    """Load and velocity of one joint over two seconds: real, nominal, corrected."""
    from plotly import graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    runs = (("real", real, "#26313b"), ("nominal", nominal, RED), ("corrected", corrected, GREEN))
    for title, run, colour in runs:
        if run is None:
            continue
        rows = policy_ticks(run)
        if len(rows) == 0:
            continue
        time_s = (run.states.robot_stamp_ns - run.ticks.robot_stamp_ns[rows[0]]) * 1e-9
        part = np.flatnonzero((time_s >= TRACE_S[0]) & (time_s < TRACE_S[1]))[:MAX_POINTS]
        for row, values in ((1, run.states.load_nm), (2, run.states.velocity_rad_s)):
            figure.add_trace(
                go.Scatter(
                    x=np.round(time_s[part], 4).tolist(), y=np.round(values[part, joint], 3).tolist(), name=title,
                    line={"color": colour, "width": 1.4}, showlegend=row == 1, legendgroup=title,
                ), row=row, col=1,
            )  # fmt: skip
    figure.update_yaxes(title="load, N·m", row=1, col=1)
    figure.update_yaxes(title="velocity, rad/s", row=2, col=1)
    figure.update_xaxes(title="time under the policy, s", row=2, col=1)
    return div(figure, 460)


def unknown_curves(unknown: UnknownEffect) -> str:
    """What is left, over the quantities that it depends on most."""
    from plotly import graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=1, cols=max(1, len(unknown.curves)))
    for k, curve in enumerate(unknown.curves):
        figure.add_trace(
            go.Scatter(x=curve.at, y=curve.residual, mode="lines+markers", line={"color": "#7d3c98"}), row=1, col=k + 1
        )
        figure.update_xaxes(title=f"{curve.quantity} (importance {curve.importance:.2f})", row=1, col=k + 1)
    figure.update_yaxes(title=f"unexplained, {unknown.unit}", row=1, col=1)
    figure.update_layout(showlegend=False)
    return div(figure, 300)
