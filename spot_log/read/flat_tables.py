"""A run as flat tables: one named scalar column a signal and joint, as plotting programs and data frames like it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run

Table = dict[str, NDArray[Any]]
"""Columns of equal length by name; ``pandas.DataFrame`` takes one as it is."""


def tables_of(run: Run) -> dict[str, Table]:
    """All tables of a run by topic: state, imu, command, tick, slow_state, event."""
    names = {"joints": tuple(run.header.joint_names), "feet": tuple(run.header.foot_names)}
    return {
        "state": run.states.flat(names),
        "imu": run.states.imu.flat(names),
        "command": run.commands.flat(names),
        "tick": run.ticks.flat(names),
        "slow_state": {**run.slow_states.flat(names), **_lists(run)},
        "event": _events(run),
    }


def _lists(run: Run) -> Table:
    """What a poll has any number of: a column a battery's cell, and faults in one text."""
    slow, table = run.slow_states, {}
    cells = max((len(row) for row in slow.battery_temperature_c), default=0)
    for i in range(cells):
        column = [row[i] if i < len(row) else np.nan for row in slow.battery_temperature_c]
        table[f"battery_temperature_c.{i}"] = np.array(column, dtype=np.float64)
    for name in ("system_faults", "behavior_faults", "service_faults"):
        table[name] = np.array(["; ".join(row) for row in getattr(slow, name)], dtype=np.str_)
    return table


def _events(run: Run) -> Table:
    events = run.events
    return {
        "host_stamp_ns": np.array([event.host_stamp_ns for event in events], dtype=np.int64),
        "robot_stamp_ns": np.array([event.robot_stamp_ns for event in events], dtype=np.int64),
        "severity": np.array([event.severity.name.lower() for event in events], dtype=np.str_),
        "name": np.array([event.name for event in events], dtype=np.str_),
        "text": np.array([event.text for event in events], dtype=np.str_),
        "values": np.array(
            ["; ".join(f"{key}={value!r}" for key, value in event.values.items()) for event in events], dtype=np.str_
        ),
    }
