"""A whole run in memory: numpy arrays by topic, one row a message, in the order of the file.

A signal that the source lacks is NaN in every row (contacts: no columns). J is the number of joints, F of feet, both
named in the header; for Spot 12 and 4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot_log.format import events
from spot_log.format.records import EventRecord, RunHeader
from spot_model.robot.state import Array

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class ImuTable:
    """All packets of the inertial unit, m rows, about three a state."""

    state_index: Ints
    """Row of the state that carried the packet. Shape (m,)."""
    robot_stamp_ns: Ints
    acceleration_of_imu_in_link_m_s2: Array
    """Shape (m, 3)."""
    angular_vel_of_link_in_link_rad_s: Array
    """Shape (m, 3)."""
    odom_from_link_wxyz: Array
    """Shape (m, 4)."""


@dataclass(frozen=True)
class StateTable:
    """Every state message, n rows."""

    robot_stamp_ns: Ints
    """When the joints were sampled, robot clock. Shape (n,)."""
    host_stamp_ns: Ints
    """When the message was received, host clock. Shape (n,)."""
    sequence: Ints
    """Number of the message, counted from 0; a gap is a message lost between the loop and the log. Shape (n,)."""
    position_rad: Array
    """Shape (n, J)."""
    velocity_rad_s: Array
    """Shape (n, J)."""
    load_nm: Array
    """Shape (n, J)."""
    position_of_body_in_odom_m: Array
    """Shape (n, 3)."""
    odom_from_body_wxyz: Array
    """Shape (n, 4)."""
    linear_vel_of_body_in_odom_m_s: Array
    """Shape (n, 3)."""
    angular_vel_of_body_in_odom_rad_s: Array
    """Shape (n, 3)."""
    foot_contact: NDArray[np.bool_]
    """Shape (n, F), or (n, 0) where the source has none."""
    last_command_key: Ints
    """Newest command that the robot had received; 0 before the first. Shape (n,)."""
    last_command_robot_stamp_ns: Ints
    """When it had, robot clock; 0 before the first. Shape (n,)."""
    imu: ImuTable

    def __len__(self) -> int:
        return len(self.robot_stamp_ns)


@dataclass(frozen=True)
class CommandTable:
    """Every command sent, n rows; stamps and set-points as in :class:`~spot_log.format.records.CommandRecord`."""

    key: Ints
    host_stamp_ns: Ints
    robot_stamp_ns: Ints
    state_robot_stamp_ns: Ints
    end_robot_stamp_ns: Ints
    requested_position_rad: Array
    """Shape (n, J), like all that follow."""
    position_rad: Array
    velocity_rad_s: Array
    load_nm: Array
    kp_nm_per_rad: Array
    kd_nm_s_per_rad: Array

    def __len__(self) -> int:
        return len(self.key)


@dataclass(frozen=True)
class TickTable:
    """Every policy tick, n rows; fields as in :class:`~spot_log.format.records.TickRecord`."""

    index: Ints
    robot_stamp_ns: Ints
    host_stamp_ns: Ints
    mode: NDArray[np.str_]
    observation: NDArray[np.float32]
    """Shape (n, 48); NaN where the tick ran no policy."""
    action: NDArray[np.float32]
    """Shape (n, J); NaN where the tick ran no policy."""
    velocity_command: Array
    """V_x, V_y (m/s), ω_z (rad/s). Shape (n, 3)."""
    state_age_s: Array
    inference_s: Array
    compute_s: Array
    command_key: Ints
    skipped: Ints

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True)
class SlowTable:
    """Every poll of battery, temperatures and faults, n rows."""

    robot_stamp_ns: Ints
    host_stamp_ns: Ints
    motors_powered: NDArray[np.bool_]
    estopped: NDArray[np.bool_]
    battery_charge_percent: Array
    battery_voltage_v: Array
    battery_current_a: Array
    """Negative while discharging."""
    battery_temperature_c: tuple[tuple[float, ...], ...]
    motor_temperature_c: Array
    """Shape (n, J), in joint order; NaN where the robot reports none."""
    system_faults: tuple[tuple[str, ...], ...]
    behavior_faults: tuple[tuple[str, ...], ...]
    service_faults: tuple[tuple[str, ...], ...]

    def __len__(self) -> int:
        return len(self.robot_stamp_ns)


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
    header: RunHeader
    states: StateTable
    commands: CommandTable
    ticks: TickTable
    slow_states: SlowTable
    events: tuple[EventRecord, ...]
    footer: RunFooter | None
    damage: tuple[str, ...] = ()
    """What could not be read, a sentence each; empty for a whole log."""

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

    @property
    def duration_s(self) -> float:
        """From the first to the last state, robot time; 0 with fewer than two."""
        stamps = self.states.robot_stamp_ns
        return float(stamps[-1] - stamps[0]) * 1e-9 if len(stamps) > 1 else 0.0
