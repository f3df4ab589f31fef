"""A run as flat tables: one named scalar column a signal and joint, as plotting programs and data frames like it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run

Table = dict[str, NDArray[Any]]
"""Columns of equal length by name."""

_AXES: Final = ("x", "y", "z")
_WXYZ: Final = ("w", "x", "y", "z")
_VELOCITY: Final = ("x_m_s", "y_m_s", "yaw_rad_s")


def tables_of(run: Run) -> dict[str, Table]:
    """All tables of a run by topic: state, imu, command, tick, slow_state, event."""
    return {
        "state": _states(run),
        "imu": _imu(run),
        "command": _commands(run),
        "tick": _ticks(run),
        "slow_state": _slow_states(run),
        "event": _events(run),
    }


def _spread(table: Table, name: str, values: NDArray[Any], parts: Sequence[str]) -> None:
    """Add one column a part: ``name.part``; nothing where the signal is missing altogether."""
    if values.shape[1] != len(parts):
        return
    for i, part in enumerate(parts):
        table[f"{name}.{part}"] = values[:, i]


def _states(run: Run) -> Table:
    states, joints = run.states, run.header.joint_names
    table: Table = {
        "robot_stamp_ns": states.robot_stamp_ns,
        "host_stamp_ns": states.host_stamp_ns,
        "sequence": states.sequence,
        "last_command_key": states.last_command_key,
        "last_command_robot_stamp_ns": states.last_command_robot_stamp_ns,
    }
    for name in ("position_rad", "velocity_rad_s", "load_nm"):
        _spread(table, name, getattr(states, name), joints)
    for name in (
        "position_of_body_in_odom_m",
        "linear_vel_of_body_in_odom_m_s",
        "angular_vel_of_body_in_odom_rad_s",
    ):
        _spread(table, name, getattr(states, name), _AXES)
    _spread(table, "odom_from_body_wxyz", states.odom_from_body_wxyz, _WXYZ)
    _spread(table, "foot_contact", states.foot_contact, run.header.foot_names)
    return table


def _imu(run: Run) -> Table:
    imu = run.states.imu
    table: Table = {"robot_stamp_ns": imu.robot_stamp_ns, "state_index": imu.state_index}
    for name in ("acceleration_of_imu_in_link_m_s2", "angular_vel_of_link_in_link_rad_s"):
        _spread(table, name, getattr(imu, name), _AXES)
    _spread(table, "odom_from_link_wxyz", imu.odom_from_link_wxyz, _WXYZ)
    return table


def _commands(run: Run) -> Table:
    commands, joints = run.commands, run.header.joint_names
    names = ("key", "host_stamp_ns", "robot_stamp_ns", "state_robot_stamp_ns", "end_robot_stamp_ns")
    table: Table = {name: getattr(commands, name) for name in names}
    for name in (
        "requested_position_rad",
        "position_rad",
        "velocity_rad_s",
        "load_nm",
        "kp_nm_per_rad",
        "kd_nm_s_per_rad",
    ):
        _spread(table, name, getattr(commands, name), joints)
    return table


def _ticks(run: Run) -> Table:
    ticks = run.ticks
    names = (
        "index",
        "robot_stamp_ns",
        "host_stamp_ns",
        "mode",
        "state_age_s",
        "inference_s",
        "compute_s",
        "command_key",
        "skipped",
    )
    table: Table = {name: getattr(ticks, name) for name in names}
    _spread(table, "velocity_command", ticks.velocity_command, _VELOCITY)
    _spread(table, "action", ticks.action, run.header.joint_names)
    _spread(table, "observation", ticks.observation, [f"{i:02d}" for i in range(ticks.observation.shape[1])])
    return table


def _slow_states(run: Run) -> Table:
    slow = run.slow_states
    names = (
        "robot_stamp_ns",
        "host_stamp_ns",
        "motors_powered",
        "estopped",
        "battery_charge_percent",
        "battery_voltage_v",
        "battery_current_a",
    )
    table: Table = {name: getattr(slow, name) for name in names}
    cells = max((len(row) for row in slow.battery_temperature_c), default=0)
    for i in range(cells):
        column = [row[i] if i < len(row) else np.nan for row in slow.battery_temperature_c]
        table[f"battery_temperature_c.{i}"] = np.array(column, dtype=np.float64)
    _spread(table, "motor_temperature_c", slow.motor_temperature_c, run.header.joint_names)
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
