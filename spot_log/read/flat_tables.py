"""A run as flat tables: one named scalar column a signal and joint, as plotting programs and data frames like it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run
from spot_model.errors import BadInputError

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


class FrameError(BadInputError):
    """A run cannot be given as a data frame."""


def frame_of(run: Run, topic: str) -> Any:
    """One topic as a ``pandas.DataFrame``, indexed by ``time_s``: robot time since the first state, or NaN.

    Raises:
        FrameError: The topic is unknown, or pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise FrameError("data frames need pandas: pip install 'spot-rl[report]'") from error
    tables = tables_of(run)
    if topic not in tables:
        raise FrameError(f"topic {topic!r} is not in a log; allowed: {', '.join(tables)}")
    table = tables[topic]
    stamps = table["robot_stamp_ns"]
    start_ns = int(run.states.robot_stamp_ns[0]) if len(run.states) else int(stamps.min(initial=0))
    time_s = np.where(stamps > 0, (stamps - start_ns) * 1e-9, np.nan)
    return pd.DataFrame(dict(table), index=pd.Index(time_s, name="time_s"))
