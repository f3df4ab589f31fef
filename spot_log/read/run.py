"""A whole run in memory: its header, its tables, its events, and what could not be read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_log.format import events
from spot_log.format.records import EventRecord, RunHeader
from spot_log.format.tables import ArmTable, CommandTable, ImuTable, Ints, SlowTable, StateTable, TickTable
from spot_model.errors import BadInputError
from spot_model.policy.observation import N_OBSERVATION

__all__ = ["ArmTable", "CommandTable", "ImuTable", "Ints", "Run", "RunFooter", "SlowTable", "StateTable", "TickTable"]


@dataclass(frozen=True)
class RunFooter:
    """What the log's process wrote last; missing where the log is cut."""

    host_stamp_ns: int
    messages: Mapping[str, int]
    """Written, by topic."""
    dropped: Mapping[str, int]
    """Lost before they reached the disk, by topic."""
    outcome: str
    """``completed``, or the reason of the stop."""


@dataclass(frozen=True)
class Run:
    """One log."""

    path: Path
    """The file; of a simulated run, what messages call it."""
    header: RunHeader
    """Robot, policy, configuration and labels."""
    states: StateTable
    """Each message of the robot's state stream, 333 per second."""
    commands: CommandTable
    """Each command sent to the robot."""
    ticks: TickTable
    """Each step of the policy, 50 per second."""
    slow_states: SlowTable
    """Battery, temperatures and power, 5 per second."""
    events: tuple[EventRecord, ...]
    """Modes, stops, warnings and labels."""
    footer: RunFooter | None
    """Counts, and how the run ended; None if the log was not closed."""
    damage: tuple[str, ...] = field(default_factory=tuple)
    """What could not be read, a sentence each; empty for a whole log."""
    arm: ArmTable = field(default_factory=lambda: ArmTable.of(0, {}))
    """The joints of an arm in each of the states; no rows for a robot without one."""

    def __repr__(self) -> str:
        """In one line: the arrays would fill a screen."""
        return f"<Run {self.path.name}: {self.duration_s:.1f} s, {len(self.states)} states, {self.outcome}>"

    @property
    def truncated(self) -> bool:
        """Whether something is missing: the end of the log, or a damaged stretch."""
        return bool(self.damage)

    @property
    def labels(self) -> dict[str, str]:
        """The header's labels, and those that were given while the log was written; a later one counts."""
        given = (event.text.partition("=") for event in self.events if event.name == events.EventName.LABEL.label)
        return {**self.header.labels, **{key: value for key, _, value in given}}

    @property
    def outcome(self) -> str:
        """How the run ended, as far as the log knows."""
        return self.footer.outcome if self.footer else "unknown: the log ends without a footer"

    def to_pandas(self, topic: str = "state") -> Any:
        """One topic as a ``pandas.DataFrame``, indexed by seconds since the first state; NaN without a robot stamp.

        The name of a column is that of its array and element: ``load_nm.fl_kn`` (a joint),
        ``foot_contact.fl`` (a foot), ``position_of_body_in_odom_m.x``, ``odom_from_body_wxyz.w``,
        ``velocity_command.x_m_s`` (``y_m_s``, ``yaw_rad_s``), ``observation.00``.

        Args:
            topic: state, imu, arm, command, tick, slow_state or event.

        Raises:
            FrameError: The topic is unknown, or pandas is not installed.
        """
        return frame_of(self, topic)

    @property
    def duration_s(self) -> float:
        """From the first to the last state, robot time; 0 with fewer than two."""
        stamps = self.states.robot_stamp_ns
        return float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) > 1 else 0.0

    @property
    def policy_rows(self) -> NDArray[np.intp]:
        """Numbers of the ticks that ran a policy, shape (k,)."""
        ticks = self.ticks
        return np.flatnonzero(np.isfinite(ticks.observation).all(axis=1) & np.isfinite(ticks.action).all(axis=1))


def run_of_columns(
    path: Path, header: RunHeader, *, states: Mapping[str, Any], commands: Mapping[str, Any], ticks: Mapping[str, Any]
) -> Run:
    """A run from columns in memory, such as a simulation's; columns that are not given hold missing values.

    Messages call it ``path``; the header's names give the number of joints and feet. ``robot_stamp_ns`` of states and
    ticks, and ``key`` of commands, are needed.
    """
    n_states = len(states["robot_stamp_ns"])
    widths = {"joints": len(header.joint_names), "feet": 0, "#": N_OBSERVATION}
    counted = {"sequence": np.arange(n_states), "host_stamp_ns": states["robot_stamp_ns"]}
    return Run(
        path=path,
        header=header,
        states=StateTable.of(n_states, widths, **{**counted, **states}),
        commands=CommandTable.of(len(commands["key"]), widths, **commands),
        ticks=TickTable.of(len(ticks["robot_stamp_ns"]), widths, **ticks),
        slow_states=SlowTable.of(0, widths),
        events=(),
        footer=None,
    )


Columns = dict[str, NDArray[Any]]
"""Columns of equal length by name; ``pandas.DataFrame`` takes one as it is."""


def tables_of(run: Run) -> dict[str, Columns]:
    """All tables of a run by topic: state, imu, arm, command, tick, slow_state, event."""
    names = {"joints": tuple(run.header.joint_names), "feet": tuple(run.header.foot_names)}
    return {
        "state": run.states.flat(names),
        "imu": run.states.imu.flat(names),
        "arm": run.arm.flat(names),
        "command": run.commands.flat(names),
        "tick": run.ticks.flat(names),
        "slow_state": {**run.slow_states.flat(names), **_lists(run)},
        "event": _events(run),
    }


def _lists(run: Run) -> Columns:
    """What a poll has any number of: a column a battery's cell, and faults in one text."""
    slow, table = run.slow_states, {}
    cells = max((len(row) for row in slow.battery_temperature_c), default=0)
    for i in range(cells):
        column = [row[i] if i < len(row) else np.nan for row in slow.battery_temperature_c]
        table[f"battery_temperature_c.{i}"] = np.array(column, dtype=np.float64)
    for name in ("system_faults", "behavior_faults", "service_faults"):
        table[name] = np.array(["; ".join(row) for row in getattr(slow, name)], dtype=np.str_)
    return table


def _events(run: Run) -> Columns:
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
    if topic not in list(tables):
        raise FrameError(f"topic {topic!r} is not in a log; allowed: {', '.join(tables)}")
    table = tables[topic]
    stamps = table["robot_stamp_ns"]
    start_ns = int(run.states.robot_stamp_ns[0]) if len(run.states) else int(stamps.min(initial=0))
    time_s = np.where(stamps > 0, (stamps - start_ns) * 1e-9, np.nan)
    return pd.DataFrame(dict(table), index=pd.Index(time_s, name="time_s"))
