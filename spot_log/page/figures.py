"""The plots of a run's page, in its order: each function takes a run and gives one plotly figure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from spot_log.page.draw import ASKED, FEET, LIMIT, MEASURED, NEUTRAL, histogram, line, stance_diagram, styled
from spot_log.read.run import Run
from spot_log.tools import measures
from spot_model.robot.facts import HIP_TORQUE_LIMIT_NM
from spot_model.robot.knee_table import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM

WINDOW_S: Final = 4.0
"""What joints and contacts show at first: the gait is not to be seen in a longer stretch."""
_WINDOW: Final = "Four seconds of the run; double-click for all of it."

Draw = Callable[[Run], "go.Figure | None"]


@dataclass(frozen=True)
class Figure:
    """One section of the page with its plot."""

    heading: str
    note: str
    draw: Draw


FIGURES: Final[dict[str, Figure]] = {}
"""Every plot of the page by the name of its function, in the order of the page."""


def figure(heading: str, note: str) -> Callable[[Draw], Draw]:
    """Put a function that draws a run into the page; it gives None where the run has no data for it."""

    def add(draw: Draw) -> Draw:
        FIGURES[draw.__name__] = Figure(heading, note, draw)
        return draw

    return add


@figure("Velocity", "What was commanded and what the body did, in the body frame. Dotted: warnings, errors.")
def velocity(run: Run) -> go.Figure | None:
    """Velocity command against the body's velocity, both in the body frame."""
    if not np.isfinite(run.states.linear_vel_of_body_in_odom_m_s).any() and not len(run.ticks):
        return None
    linear, angular = measures.body_velocity(run)
    measured = np.column_stack([linear[:, :2], angular[:, 2]])
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    tick_s = measures.seconds(run, run.ticks.robot_stamp_ns)
    titles = ("forward, m/s", "to the left, m/s", "turning left, rad/s")
    drawn = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06, subplot_titles=titles)
    for axis in range(3):
        line(drawn, time_s, measured[:, axis], "body", MEASURED, row=axis + 1, first=axis == 0)
        if len(tick_s):
            wanted = run.ticks.velocity_command[:, axis]
            line(drawn, tick_s, wanted, "command", ASKED, row=axis + 1, first=axis == 0, step=True, width=2)
    _mark_events(drawn, run)
    drawn.update_xaxes(title_text="time, s", row=3, col=1)
    return styled(drawn, 520)


@figure("Joints", f"Measured position and the set-point that was sent. {_WINDOW}")
def joints(run: Run) -> go.Figure | None:
    """Position and set-point of every joint: a column a leg, a row a joint."""
    if not len(run.states):
        return None
    drawn, places = _joint_grid(run)
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    sent_s = measures.seconds(run, run.commands.robot_stamp_ns)
    window = _window(run)
    for j, (row, col) in enumerate(places):
        if len(sent_s):
            sent = run.commands.position_rad[:, j]
            line(drawn, sent_s, sent, "set-point", ASKED, row=row, col=col, first=j == 0, step=True)
        measured = run.states.position_rad[:, j]
        line(drawn, time_s, measured, "position", MEASURED, row=row, col=col, first=j == 0)
        shown = [_within(window, time_s, measured)]
        if len(sent_s):
            shown.append(_within(window, sent_s, sent))
        drawn.update_yaxes(range=_span(np.concatenate(shown)), row=row, col=col)
    drawn.update_yaxes(title_text="rad", col=1)
    drawn.update_xaxes(range=window)
    return styled(drawn, 210 * _n_rows(places) + 60)


@figure("Loads", "Measured torque of each joint; red: what the joint can give, for the knee at its position.")
def loads(run: Run) -> go.Figure | None:
    """Measured load of every joint with the robot's limits, where they are known."""
    if not np.isfinite(run.states.load_nm).any():
        return None
    drawn, places = _joint_grid(run)
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    for j, (row, col) in enumerate(places):
        load = run.states.load_nm[:, j]
        line(drawn, time_s, load, "load", MEASURED, row=row, col=col, first=j == 0)
        limit = _torque_limit_nm(run, j)
        if limit is None:
            continue
        for sign in (1.0, -1.0):
            shown = j == 0 and sign > 0
            line(drawn, time_s, sign * limit, "limit", LIMIT, row=row, col=col, first=shown, width=1, points=200)
    drawn.update_yaxes(title_text="N·m", col=1)
    return styled(drawn, 210 * _n_rows(places) + 60)


@figure("Timing", "One count a tick or command. Dotted: median and 99th percentile.")
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
    drawn = make_subplots(rows=1, cols=4, subplot_titles=[title for title, _ in panels], horizontal_spacing=0.05)
    for col, (_, values) in enumerate(panels, start=1):
        histogram(drawn, values[np.isfinite(values)], col)
    drawn.update_yaxes(title_text="count", col=1)
    return styled(drawn, 300, legend=False)


@figure("Contacts", f"A bar while the foot is on the ground. {_WINDOW}")
def contacts(run: Run) -> go.Figure | None:
    """When each foot was on the ground."""
    stance = run.states.foot_contact
    if not stance.shape[1] or not len(stance):
        return None
    drawn = stance_diagram(measures.seconds(run, run.states.robot_stamp_ns), stance, run.header.foot_names)
    drawn.update_xaxes(range=_window(run))
    return drawn


@figure("Battery and temperatures", "Polled a few times a second.")
def power(run: Run) -> go.Figure | None:
    """Battery and motor temperatures."""
    slow = run.slow_states
    if not len(slow):
        return None
    time_s = measures.seconds(run, slow.robot_stamp_ns)
    titles = ("battery voltage, V", "battery current, A", "battery charge, %", "motor temperature, °C")
    drawn = make_subplots(rows=1, cols=4, subplot_titles=titles, horizontal_spacing=0.05)
    for col, values in enumerate((slow.battery_voltage_v, slow.battery_current_a, slow.battery_charge_percent), 1):
        line(drawn, time_s, values, titles[col - 1], MEASURED, col=col, first=False, width=2)
    for j, name in enumerate(run.header.joint_names):
        temperature = slow.motor_temperature_c[:, j]
        if np.isfinite(temperature).any():
            line(drawn, time_s, temperature, name, FEET[(j // 3) % 4], col=4, first=False)
    drawn.update_xaxes(title_text="time, s")
    return styled(drawn, 300, legend=False)


def _joint_grid(run: Run) -> tuple[go.Figure, list[tuple[int, int]]]:
    """A drawn with a panel a joint (Spot: a column a leg; others: rows of four), and each joint's row and column."""
    names = run.header.joint_names
    n = len(names)
    by_leg = n == 3 * len(run.header.foot_names)
    n_cols = n // 3 if by_leg else min(4, n)
    n_rows = 3 if by_leg else -(-n // n_cols)
    places = [(j % 3 + 1, j // 3 + 1) if by_leg else (j // n_cols + 1, j % n_cols + 1) for j in range(n)]
    titles = [""] * (n_rows * n_cols)
    for name, (row, col) in zip(names, places, strict=True):
        titles[(row - 1) * n_cols + col - 1] = name
    drawn = make_subplots(
        rows=n_rows,
        cols=n_cols,
        shared_xaxes="all",
        subplot_titles=titles,
        vertical_spacing=0.07,
        horizontal_spacing=0.045,
    )
    drawn.update_xaxes(title_text="time, s", row=n_rows)
    return drawn, places


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


def _mark_events(drawn: go.Figure, run: Run) -> None:
    """A dotted line at every warning and error, at most 40."""
    if not len(run.states):
        return
    first_ns = int(run.states.host_stamp_ns[0])
    marked = [event for event in run.events if event.severity > 1][:40]
    for event in marked:
        color = LIMIT if event.severity > 2 else NEUTRAL
        at = (event.host_stamp_ns - first_ns) * 1e-9
        drawn.add_vline(x=at, line={"color": color, "width": 1, "dash": "dot"})
