"""The plots of a run's page, in its order: each function takes a run and gives one plot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_log.page.charts import FEET, histogram, stance
from spot_log.page.sections import Beside, Chart, Content, Legend, Series, Shade
from spot_log.read.run import Run
from spot_log.tools import measures
from spot_model.robot.facts import HIP_TORQUE_LIMIT_NM, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM

MEASURED: Final = "var(--floor)"
ASKED: Final = "var(--group)"
LIMIT: Final = "var(--bad)"
"""Colours of what was measured, of what was asked for, and of limits."""
WINDOW_S: Final = 4.0
"""What joints and contacts show: the gait is not to be seen in a longer stretch."""
_WINDOW: Final = "At most four seconds of the run are shown; Foxglove shows all of it."
_STEP_S: Final = 0.003
"""Time step of the gait diagram."""

Draw = Callable[[Run], Content]


class Figure(NamedTuple):
    """One section of the page with its plot."""

    heading: str
    note: str
    draw: Draw


FIGURES: Final[dict[str, Figure]] = {}
"""Every plot of the page by the name of its function, in the order of the page."""


def figure(heading: str, note: str) -> Callable[[Draw], Draw]:
    """Add a function that draws a run to the page; it gives None if the run has no data for it."""

    def add(draw: Draw) -> Draw:
        FIGURES[draw.__name__] = Figure(heading, note, draw)
        return draw

    return add


@figure("Velocity", "What was commanded and what the body did, in the body frame. Thin stripes: warnings and errors.")
def velocity(run: Run) -> Content:
    """Velocity command against the body's velocity, both in the body frame."""
    if not np.isfinite(run.states.linear_vel_of_body_in_odom_m_s).any() and not len(run.ticks):
        return None
    linear, angular = measures.body_velocity(run)
    measured = np.column_stack([linear[:, :2], angular[:, 2]])
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    tick_s = measures.seconds(run, run.ticks.robot_stamp_ns)
    asked, has_ticks, drawn = run.ticks.velocity_command, len(tick_s) > 0, []
    for axis, title in enumerate(("forward, m/s", "to the left, m/s", "turning left, rad/s")):
        lines = [Series(MEASURED, time_s, measured[:, axis])]
        lines += [Series(ASKED, tick_s, asked[:, axis], width=2, is_stepped=True)] if has_ticks else []
        drawn.append(Chart(lines, title, x_unit=" s", height=120, shades=_events(run), least_span=0.2))
    return [Legend([(MEASURED, "the body"), (ASKED, "command" if has_ticks else "")]), *drawn]


@figure("Feet on the ground", f"A bar while the foot stands. {_WINDOW}")
def contacts(run: Run) -> Content:
    """When each foot was on the ground."""
    down = run.states.foot_contact
    if not len(down) or not down.shape[1]:
        return None
    first_s, last_s = _window(run)
    at_s = np.arange(first_s, last_s, _STEP_S)
    rows = np.searchsorted(measures.seconds(run, run.states.robot_stamp_ns), at_s, side="right") - 1
    return stance(down[np.maximum(rows, 0)], run.header.foot_names, MEASURED, (first_s, last_s))


@figure(
    "Joints", f"Measured position and the set-point that was sent, rad; joints of one type share a scale. {_WINDOW}"
)
def joints(run: Run) -> Content:
    """Position and set-point of every joint: a column a leg, a row a joint."""
    if not len(run.states):
        return None
    first_s, last_s = _window(run)
    measured_s, sent_s = (measures.seconds(run, t.robot_stamp_ns) for t in (run.states, run.commands))
    seen, sent = ((time_s >= first_s) & (time_s <= last_s) for time_s in (measured_s, sent_s))
    found = [[Series(MEASURED, measured_s[seen], values)] for values in run.states.position_rad[seen].T]
    for lines, asked in zip(found, run.commands.position_rad[sent].T if sent.any() else (), strict=False):
        lines.insert(0, Series(ASKED, sent_s[sent], asked, is_stepped=True))
    legend = Legend([(MEASURED, "position"), (ASKED, "set-point" if sent.any() else "")])
    return [legend, _grid(run, found, least_span=0.1)]


@figure("Loads", "Measured torque of each joint, N·m, over the whole run; joints of one type share a scale.")
def loads(run: Run) -> Content:
    """Measured load of every joint with the robot's limits, where they are known."""
    if not np.isfinite(run.states.load_nm).any():
        return None
    time_s = measures.seconds(run, run.states.robot_stamp_ns)
    found = [[Series(MEASURED, time_s, load_nm, width=1)] for load_nm in run.states.load_nm.T]
    limits = [torque_limit_nm(run, j) for j in range(len(found))]
    for lines, limit in zip(found, limits, strict=True):
        if limit is not None:
            lines.extend(Series(LIMIT, time_s, sign * limit, width=1) for sign in (1.0, -1.0))
    is_known = any(limit is not None for limit in limits)
    told = "what the joint can give (for a knee, this depends on its position)" if is_known else ""
    return [Legend([(MEASURED, "load"), (LIMIT, told)]), _grid(run, found, least_span=1.0)]


@figure("Timing", "How many ticks or commands; the dotted lines are the median and the 99th percentile.")
def timing(run: Run) -> Content:
    """Histograms of compute time, state age, state to command, and the command's way to the robot."""
    counted = {
        "compute time of a tick, µs": run.ticks.compute_s * 1e6,
        "age of the state at the tick, ms": run.ticks.state_age_s * 1e3,
        "state received to command sent, ms": measures.state_to_command_s(run) * 1e3,
        "command sent to received by robot, ms": measures.command_delay_s(run)[1] * 1e3,
    }
    if not any(np.isfinite(values).any() for values in counted.values()):
        return None
    return Beside([histogram(values, title) for title, values in counted.items()], 4)


@figure("Battery and temperatures", "Polled a few times a second.")
def power(run: Run) -> Content:
    """Battery and motor temperatures."""
    slow = run.slow_states
    if not len(slow):
        return None
    time_s = measures.seconds(run, slow.robot_stamp_ns)
    battery = {
        "battery voltage, V": slow.battery_voltage_v,
        "battery current, A": slow.battery_current_a,
        "battery charge, %": slow.battery_charge_percent,
    }
    lines = {title: [Series(MEASURED, time_s, values, width=2)] for title, values in battery.items()}
    motors = enumerate(slow.motor_temperature_c.T)
    lines["motor temperatures, °C"] = [Series(FEET[(j // 3) % 4], time_s, values) for j, values in motors]
    drawn = [Chart(s, title=title, x_unit=" s", height=110, least_span=1.0) for title, s in lines.items()]
    legs, is_known = run.header.foot_names, np.isfinite(slow.motor_temperature_c).any()
    is_named = is_known and len(legs) == len(FEET)
    names = [(colour, f"motors of {leg}") for colour, leg in zip(FEET, legs, strict=False)] if is_named else []
    return [Legend(names), Beside(drawn, 4)]


def torque_limit_nm(run: Run, joint: int) -> NDArray[Any] | None:
    """Spot's torque limit at every state, shape (n,); None for a joint of another robot."""
    name = run.header.joint_names[joint]
    position = run.states.position_rad[:, joint]
    if name.endswith(("_hx", "_hy")):
        return np.full(len(position), HIP_TORQUE_LIMIT_NM)
    if name.endswith("_kn"):
        return np.interp(position, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM)
    return None


def _grid(run: Run, found: list[list[Series]], *, least_span: float) -> Beside:
    """A small plot of each joint: a leg each column where legs have three joints; those of one type share a scale."""
    names, drawn = run.header.joint_names, []
    is_by_leg = len(names) == 12 and len(run.header.foot_names) == 4
    for row in [range(kind, 12, 3) for kind in range(3)] if is_by_leg else [range(len(names))]:
        values = np.concatenate([np.asarray(s.y, dtype=np.float64) for j in row for s in found[j]])
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        pad = max(0.06 * (high - low), 0.5 * (least_span - (high - low)))
        y_range = (low - pad, high + pad)
        drawn += [Chart(found[j], title=names[j], x_unit=" s", height=110, y_range=y_range) for j in row]
    return Beside(drawn, 4)


def _window(run: Run) -> tuple[float, float]:
    """The middle of the policy's ticks, or of the run where there are none; at most :data:`WINDOW_S` long."""
    stamps_ns = run.ticks.robot_stamp_ns if len(run.ticks) else run.states.robot_stamp_ns
    time_s = measures.seconds(run, stamps_ns)
    first, last = float(time_s[0]), float(time_s[-1])
    middle, half = 0.5 * (first + last), 0.5 * min(WINDOW_S, last - first)
    return middle - half, middle + half


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
