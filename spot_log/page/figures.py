"""The plots of a run's page: each function takes a run and gives one plotly figure, or None where there is no data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from spot_log.page.thin import thin_rows
from spot_log.read.run import Run
from spot_log.tools import measures
from spot_model.robot.facts import HIP_TORQUE_LIMIT_NM
from spot_model.robot.knee_table import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM

MAX_POINTS: Final = 1600
MAX_STANCES: Final = 4000
WINDOW_S: Final = 4.0
"""What joints and contacts show at first: the gait is not to be seen in a longer stretch."""
MEASURED: Final = "#1f6fb2"
ASKED: Final = "#d1662b"
LIMIT: Final = "#b03030"
NEUTRAL: Final = "#7a8794"
FEET: Final = ("#1f6fb2", "#d1662b", "#3c8d5a", "#8e5aa8")
_MARGIN: Final = {"l": 62, "r": 18, "t": 56, "b": 44}


def velocity(run: Run) -> go.Figure | None:
    """Velocity command against the body's velocity, both in the body frame."""
    if not np.isfinite(run.states.linear_vel_of_body_in_odom_m_s).any() and not len(run.ticks):
        return None
    linear, angular = measures.body_velocity(run)
    measured = np.column_stack([linear[:, :2], angular[:, 2]])
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    tick_s = measures.seconds(run, run.ticks.robot_stamp_ns)
    titles = ("forward, m/s", "to the left, m/s", "turning left, rad/s")
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06, subplot_titles=titles)
    for axis in range(3):
        _line(figure, time_s, measured[:, axis], "body", MEASURED, row=axis + 1, first=axis == 0)
        if len(tick_s):
            wanted = run.ticks.velocity_command[:, axis]
            _line(figure, tick_s, wanted, "command", ASKED, row=axis + 1, first=axis == 0, step=True, width=2)
    _mark_events(figure, run)
    figure.update_xaxes(title_text="time, s", row=3, col=1)
    return _styled(figure, 520)


def joints(run: Run) -> go.Figure | None:
    """Position and set-point of every joint: a column a leg, a row a joint."""
    if not len(run.states):
        return None
    figure, places = _joint_grid(run)
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    sent_s = measures.seconds(run, run.commands.robot_stamp_ns)
    window = _window(run)
    for j, (row, col) in enumerate(places):
        if len(sent_s):
            sent = run.commands.position_rad[:, j]
            _line(figure, sent_s, sent, "set-point", ASKED, row=row, col=col, first=j == 0, step=True)
        measured = run.states.position_rad[:, j]
        _line(figure, time_s, measured, "position", MEASURED, row=row, col=col, first=j == 0)
        shown = [_within(window, time_s, measured)]
        if len(sent_s):
            shown.append(_within(window, sent_s, sent))
        figure.update_yaxes(range=_span(np.concatenate(shown)), row=row, col=col)
    figure.update_yaxes(title_text="rad", col=1)
    figure.update_xaxes(range=window)
    return _styled(figure, 210 * _n_rows(places) + 60)


def loads(run: Run) -> go.Figure | None:
    """Measured load of every joint with the robot's limits, where they are known."""
    if not np.isfinite(run.states.load_nm).any():
        return None
    figure, places = _joint_grid(run)
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    for j, (row, col) in enumerate(places):
        load = run.states.load_nm[:, j]
        _line(figure, time_s, load, "load", MEASURED, row=row, col=col, first=j == 0)
        limit = _torque_limit_nm(run, j)
        if limit is None:
            continue
        for sign in (1.0, -1.0):
            _line(
                figure, time_s, sign * limit, "limit", LIMIT, row=row, col=col, first=j == 0 and sign > 0, width=1,
                points=200,
            )  # fmt: skip
    figure.update_yaxes(title_text="N·m", col=1)
    return _styled(figure, 210 * _n_rows(places) + 60)


def timing(run: Run) -> go.Figure | None:
    """Histograms of compute time, state age, state to command, and the command's way to the robot."""
    _, delay_s = measures.command_delay_s(run)
    panels = (
        ("tick's compute time, µs", run.ticks.compute_s * 1e6),
        ("age of the state at the tick, ms", run.ticks.state_age_s * 1e3),
        ("state received to command sent, ms", measures.state_to_command_s(run) * 1e3),
        ("command sent to received by the robot, ms", delay_s * 1e3),
    )
    if not any(np.isfinite(values).any() for _, values in panels):
        return None
    figure = make_subplots(rows=1, cols=4, subplot_titles=[title for title, _ in panels], horizontal_spacing=0.05)
    for col, (_, values) in enumerate(panels, start=1):
        _histogram(figure, values[np.isfinite(values)], col)
    figure.update_yaxes(title_text="count", col=1)
    return _styled(figure, 300, legend=False)


def contacts(run: Run) -> go.Figure | None:
    """When each foot was on the ground."""
    stance = run.states.foot_contact
    if not stance.shape[1] or not len(stance):
        return None
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    figure = go.Figure()
    for foot, name in enumerate(run.header.foot_names):
        x, y = _bars(time_s, stance[:, foot], foot)
        color = FEET[foot % len(FEET)]
        figure.add_trace(
            go.Scatter(x=x, y=y, mode="lines", line={"width": 20, "color": color}, name=name, hoverinfo="x+name")
        )
    names = list(run.header.foot_names)
    figure.update_yaxes(
        tickvals=list(range(len(names))),
        ticktext=names,
        range=[len(names) - 0.5, -0.5],
        showgrid=False,
        ticklabelstandoff=8,
    )
    figure.update_xaxes(title_text="time, s", range=_window(run))
    return _styled(figure, 60 * len(names) + 90, legend=False)


def power(run: Run) -> go.Figure | None:
    """Battery and motor temperatures."""
    slow = run.slow_states
    if not len(slow):
        return None
    time_s = measures.seconds(run, slow.robot_stamp_ns)
    titles = ("battery voltage, V", "battery current, A", "battery charge, %", "motor temperature, °C")
    figure = make_subplots(rows=1, cols=4, subplot_titles=titles, horizontal_spacing=0.05)
    for col, values in enumerate((slow.battery_voltage_v, slow.battery_current_a, slow.battery_charge_percent), 1):
        _line(figure, time_s, values, titles[col - 1], MEASURED, col=col, first=False, width=2)
    for j, name in enumerate(run.header.joint_names):
        temperature = slow.motor_temperature_c[:, j]
        if np.isfinite(temperature).any():
            _line(figure, time_s, temperature, name, FEET[(j // 3) % 4], col=4, first=False)
    figure.update_xaxes(title_text="time, s")
    return _styled(figure, 300, legend=False)


def _line(
    figure: go.Figure, time_s: NDArray[Any], values: NDArray[Any], name: str, color: str, *, row: int = 1,
    col: int = 1, first: bool = True, step: bool = False, width: float = 1.3, points: int = MAX_POINTS,
) -> None:  # fmt: skip
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


def _histogram(figure: go.Figure, values: NDArray[Any], col: int) -> None:
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
            x=at, y=1.0 if share == 50 else 0.86, yref="y domain", text=f"{label} {at:.4g}", showarrow=False,
            xanchor="left" if share == 50 else "right", font={"size": 11, "color": ASKED}, row=1, col=col,
        )  # fmt: skip
    if beyond:
        text = f"{beyond} more, up to {values.max():.4g}"
        figure.add_annotation(
            x=1, y=0.7, xref="x domain", yref="y domain", text=text, showarrow=False, xanchor="right",
            font={"size": 11, "color": NEUTRAL}, row=1, col=col,
        )  # fmt: skip


def _bars(time_s: NDArray[Any], mask: NDArray[np.bool_], level: int) -> tuple[list[float | None], list[int | None]]:
    """Thick line segments where the mask holds, at a height, with breaks between."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    x: list[float | None] = []
    y: list[int | None] = []
    for a, b in zip(edges[::2][:MAX_STANCES], edges[1::2][:MAX_STANCES], strict=True):
        x += [round(float(time_s[a]), 3), round(float(time_s[b - 1]), 3), None]
        y += [level, level, None]
    return x, y


def _joint_grid(run: Run) -> tuple[go.Figure, list[tuple[int, int]]]:
    """A figure with a panel a joint (Spot: a column a leg; others: rows of four), and each joint's row and column."""
    names = run.header.joint_names
    n = len(names)
    by_leg = n == 3 * len(run.header.foot_names)
    n_cols = n // 3 if by_leg else min(4, n)
    n_rows = 3 if by_leg else -(-n // n_cols)
    places = [(j % 3 + 1, j // 3 + 1) if by_leg else (j // n_cols + 1, j % n_cols + 1) for j in range(n)]
    titles = [""] * (n_rows * n_cols)
    for name, (row, col) in zip(names, places, strict=True):
        titles[(row - 1) * n_cols + col - 1] = name
    figure = make_subplots(
        rows=n_rows, cols=n_cols, shared_xaxes="all", subplot_titles=titles, vertical_spacing=0.07,
        horizontal_spacing=0.045,
    )  # fmt: skip
    figure.update_xaxes(title_text="time, s", row=n_rows)
    return figure, places


def _n_rows(places: list[tuple[int, int]]) -> int:
    return max(row for row, _ in places)


def _torque_limit_nm(run: Run, joint: int) -> NDArray[Any] | None:
    """Spot's torque limit at every state, shape (n,); None for a joint of another robot."""
    name = run.header.joint_names[joint]
    position = run.states.position_rad[:, joint]
    if name.endswith(("_hx", "_hy")):
        return np.full(len(position), HIP_TORQUE_LIMIT_NM)
    if name.endswith("_kn"):
        return np.interp(position, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM)
    return None


def _window(run: Run) -> tuple[float, float]:
    """The middle of the policy's ticks, or of the run where there are none; at most :data:`WINDOW_S` long."""
    stamps_ns = run.ticks.robot_stamp_ns if len(run.ticks) else run.states.robot_stamp_ns
    time_s = measures.seconds(run, stamps_ns)
    first, last = float(time_s[0]), float(time_s[-1])
    middle, half = 0.5 * (first + last), 0.5 * min(WINDOW_S, last - first)
    return middle - half, middle + half


def _within(window: tuple[float, float], time_s: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
    inside = values[(time_s >= window[0]) & (time_s <= window[1])]
    return np.asarray(inside[np.isfinite(inside)])


def _span(values: NDArray[Any]) -> list[float] | None:
    """Range of an axis that shows these values with some air, at least 0.1 wide; None leaves it to the plot."""
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    air = max(0.05 * (high - low), 0.5 * (0.1 - (high - low)))
    return [low - air, high + air]


def _mark_events(figure: go.Figure, run: Run) -> None:
    """A dotted line at every warning and error, at most 40."""
    if not len(run.states):
        return
    first_ns = int(run.states.host_stamp_ns[0])
    marked = [event for event in run.events if event.severity > 1][:40]
    for event in marked:
        color = LIMIT if event.severity > 2 else NEUTRAL
        at = (event.host_stamp_ns - first_ns) * 1e-9
        figure.add_vline(x=at, line={"color": color, "width": 1, "dash": "dot"})


def _styled(figure: go.Figure, height: int, *, legend: bool = True) -> go.Figure:
    figure.update_layout(
        height=height,
        margin=_MARGIN,
        showlegend=legend,
        template="plotly_white",
        hovermode="x",
        bargap=0,
        font={"family": "system-ui, sans-serif", "size": 12, "color": "#26313b"},
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1 + 22 / (height - 90), "yanchor": "bottom"},
    )
    figure.update_annotations(font_size=12)
    return figure


FIGURES: Final[dict[str, Callable[[Run], go.Figure | None]]] = {
    "velocity": velocity,
    "joints": joints,
    "loads": loads,
    "timing": timing,
    "contacts": contacts,
    "power": power,
}
"""Every plot of the page by its section's name."""
