"""The plots of a run's page, in its order: each function takes a run and gives one plot as HTML."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.page.chart import Series, Shade, chart, histogram
from spot_log.page.look import panels
from spot_log.page.rows import stance
from spot_log.page.svg import QUARTER, legend
from spot_log.read.run import Run
from spot_log.tools import measures
from spot_model.robot.facts import HIP_TORQUE_LIMIT_NM, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM

MEASURED: Final = "var(--floor)"
ASKED: Final = "var(--group)"
LIMIT: Final = "var(--bad)"
FEET: Final = ("var(--floor)", "var(--group)", "var(--good)", "var(--unknown)")
"""Colours of what was measured, of what was asked for, of limits, and of the feet fl, fr, hl, hr."""
WINDOW_S: Final = 4.0
"""What joints and contacts show: the gait is not to be seen in a longer stretch."""
_WINDOW: Final = "At most four seconds of the run are shown; Foxglove shows all of it."
_STEP_S: Final = 0.003
"""Time step of the gait diagram."""

Draw = Callable[[Run], str]


@dataclass(frozen=True)
class Figure:
    """One section of the page with its plot."""

    heading: str
    note: str
    draw: Draw


FIGURES: Final[dict[str, Figure]] = {}
"""Every plot of the page by the name of its function, in the order of the page."""


def figure(heading: str, note: str) -> Callable[[Draw], Draw]:
    """Add a function that draws a run to the page; it returns an empty text if the run has no data for it."""

    def add(draw: Draw) -> Draw:
        FIGURES[draw.__name__] = Figure(heading, note, draw)
        return draw

    return add


@figure("Velocity", "What was commanded and what the body did, in the body frame. Thin stripes: warnings and errors.")
def velocity(run: Run) -> str:
    """Velocity command against the body's velocity, both in the body frame."""
    if not np.isfinite(run.states.linear_vel_of_body_in_odom_m_s).any() and not len(run.ticks):
        return ""
    linear, angular = measures.body_velocity(run)
    measured = np.column_stack([linear[:, :2], angular[:, 2]])
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    tick_s = measures.seconds(run, run.ticks.robot_stamp_ns)
    drawn = []
    for axis, title in enumerate(("forward, m/s", "to the left, m/s", "turning left, rad/s")):
        lines = [Series(MEASURED, time_s, measured[:, axis])]
        if len(tick_s):
            lines.append(Series(ASKED, tick_s, run.ticks.velocity_command[:, axis], width=2, is_stepped=True))
        drawn.append(chart(lines, title, x_unit=" s", height=120, shades=_events(run), least_span=0.2))
    return _key((MEASURED, "the body"), (ASKED, "command" if len(tick_s) else "")) + "".join(drawn)


@figure("Feet on the ground", f"A bar while the foot stands. {_WINDOW}")
def contacts(run: Run) -> str:
    """When each foot was on the ground."""
    down = run.states.foot_contact
    if not len(down) or not down.shape[1]:
        return ""
    first_s, last_s = _window(run)
    at_s = np.arange(first_s, last_s, _STEP_S)
    rows = np.searchsorted(measures.seconds(run, run.states.robot_stamp_ns), at_s, side="right") - 1
    return stance(down[np.maximum(rows, 0)], run.header.foot_names, MEASURED, span_s=(first_s, last_s))


@figure(
    "Joints", f"Measured position and the set-point that was sent, rad; joints of one type share a scale. {_WINDOW}"
)
def joints(run: Run) -> str:
    """Position and set-point of every joint: a column a leg, a row a joint."""
    if not len(run.states):
        return ""
    measured_s = measures.seconds(run, run.states.robot_stamp_ns)
    sent_s = measures.seconds(run, run.commands.robot_stamp_ns)
    seen, sent = (_within(_window(run), time_s) for time_s in (measured_s, sent_s))
    n = len(run.header.joint_names)
    found: list[list[Series]] = [
        [Series(MEASURED, measured_s[seen], run.states.position_rad[seen, j])] for j in range(n)
    ]
    for j, lines in enumerate(found if sent.any() else ()):
        lines.insert(0, Series(ASKED, sent_s[sent], run.commands.position_rad[sent, j], is_stepped=True))
    return _key((MEASURED, "position"), (ASKED, "set-point" if sent.any() else "")) + _grid(run, found, least_span=0.1)


@figure("Loads", "Measured torque of each joint, N·m, over the whole run; joints of one type share a scale.")
def loads(run: Run) -> str:
    """Measured load of every joint with the robot's limits, where they are known."""
    if not np.isfinite(run.states.load_nm).any():
        return ""
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    found = [[Series(MEASURED, time_s, run.states.load_nm[:, j], width=1)] for j in range(len(run.header.joint_names))]
    limits = [torque_limit_nm(run, j) for j in range(len(found))]
    for lines, limit in zip(found, limits, strict=True):
        if limit is not None:
            lines.extend(Series(LIMIT, time_s, sign * limit, width=1) for sign in (1.0, -1.0))
    is_known = any(limit is not None for limit in limits)
    told = "what the joint can give (for a knee, this depends on its position)"
    return _key((MEASURED, "load"), (LIMIT, told if is_known else "")) + _grid(run, found, least_span=1.0)


@figure("Timing", "How many ticks or commands; the dotted lines are the median and the 99th percentile.")
def timing(run: Run) -> str:
    """Histograms of compute time, state age, state to command, and the command's way to the robot."""
    _, delay_s = measures.command_delay_s(run)
    counted = (
        ("compute time of a tick, µs", run.ticks.compute_s * 1e6),
        ("age of the state at the tick, ms", run.ticks.state_age_s * 1e3),
        ("state received to command sent, ms", measures.state_to_command_s(run) * 1e3),
        ("command sent to received by robot, ms", delay_s * 1e3),
    )
    if not any(np.isfinite(values).any() for _, values in counted):
        return ""
    return panels([histogram(values, title) for title, values in counted])


@figure("Battery and temperatures", "Polled a few times a second.")
def power(run: Run) -> str:
    """Battery and motor temperatures."""
    slow = run.slow_states
    if not len(slow):
        return ""
    time_s = measures.seconds(run, slow.robot_stamp_ns)
    drawn = [
        _panel([Series(MEASURED, time_s, values, width=2)], title, least_span=1.0)
        for title, values in (
            ("battery voltage, V", slow.battery_voltage_v),
            ("battery current, A", slow.battery_current_a),
            ("battery charge, %", slow.battery_charge_percent),
        )
    ]
    temperatures = [
        Series(FEET[(j // 3) % 4], time_s, slow.motor_temperature_c[:, j]) for j in range(len(run.header.joint_names))
    ]
    drawn.append(_panel(temperatures, "motor temperatures, °C", least_span=1.0))
    legs = run.header.foot_names if len(run.header.foot_names) == len(FEET) else ()
    is_known = np.isfinite(slow.motor_temperature_c).any()
    key = _key(*((colour, f"motors of {leg}") for colour, leg in zip(FEET, legs if is_known else (), strict=False)))
    return key + panels(drawn)


def torque_limit_nm(run: Run, joint: int) -> NDArray[Any] | None:
    """Spot's torque limit at every state, shape (n,); None for a joint of another robot."""
    name = run.header.joint_names[joint]
    position = run.states.position_rad[:, joint]
    if name.endswith(("_hx", "_hy")):
        return np.full(len(position), HIP_TORQUE_LIMIT_NM)
    if name.endswith("_kn"):
        return np.interp(position, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM)
    return None


def _key(*entries: tuple[str, str]) -> str:
    """Colours and their names; those without a name are not drawn."""
    named = [(colour, name) for colour, name in entries if name]
    return legend(named) if named else ""


def _panel(
    lines: list[Series], title: str, *, least_span: float = 0.0, y_range: tuple[float, float] | None = None
) -> str:
    return chart(lines, title=title, x_unit=" s", width=QUARTER, height=110, least_span=least_span, y_range=y_range)


def _grid(run: Run, found: list[list[Series]], *, least_span: float) -> str:
    """A small plot of each joint; those of one type share a scale."""
    names, ranges = run.header.joint_names, dict[int, tuple[float, float]]()
    for row in _by_type(run):
        values = np.concatenate([np.asarray(s.y, dtype=np.float64) for j in row for s in found[j]])
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        pad = max(0.06 * (high - low), 0.5 * (least_span - (high - low)))
        ranges |= dict.fromkeys(row, (low - pad, high + pad))
    return panels(_panel(found[j], names[j], y_range=ranges[j]) for row in _by_type(run) for j in row)


def _by_type(run: Run) -> list[list[int]]:
    """Joints of one type, a leg each, where legs have three joints; else all together, as they come."""
    n = len(run.header.joint_names)
    is_by_leg = n == 12 and len(run.header.foot_names) == 4
    return [[3 * leg + kind for leg in range(4)] for kind in range(3)] if is_by_leg else [list(range(n))]


def _window(run: Run) -> tuple[float, float]:
    """The middle of the policy's ticks, or of the run where there are none; at most :data:`WINDOW_S` long."""
    stamps_ns = run.ticks.robot_stamp_ns if len(run.ticks) else run.states.robot_stamp_ns
    time_s = measures.seconds(run, stamps_ns)
    first, last = float(time_s[0]), float(time_s[-1])
    middle, half = 0.5 * (first + last), 0.5 * min(WINDOW_S, last - first)
    return middle - half, middle + half


def _within(window: tuple[float, float], time_s: NDArray[Any]) -> NDArray[np.bool_]:
    return (time_s >= window[0]) & (time_s <= window[1])


def _events(run: Run) -> list[Shade]:
    """A stripe at every warning and error, at most 40."""
    if not len(run.states):
        return []
    first_ns = int(run.states.host_stamp_ns[0])
    marked = [event for event in run.events if event.severity > 1][:40]
    at = [(event.host_stamp_ns - first_ns) * 1e-9 for event in marked]
    return [
        Shade(t, t, f"{event.text} ({t:.2f} s)", LIMIT if event.severity > 2 else "var(--warn)")
        for t, event in zip(at, marked, strict=True)
    ]
