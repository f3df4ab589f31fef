"""The tables of a run: numpy arrays by topic, one row a message, in the order of the file.

A signal that the source lacks is NaN in every row (contacts: no columns). J is the number of joints, F of feet, both
named in the header; for Spot 12 and 4.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from spot_log.format.table import AXES, VELOCITY, WXYZ, Table, column
from spot_model.robot.state import Array

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class ImuTable(Table):
    """All packets of the inertial unit, m rows, about three a state."""

    state_index: Ints = column(np.int64)
    """Row of the state that carried the packet. Shape (m,)."""
    robot_stamp_ns: Ints = column(np.int64)
    acceleration_of_imu_in_link_m_s2: Array = column(np.float64, AXES)
    """Shape (m, 3)."""
    angular_vel_of_link_in_link_rad_s: Array = column(np.float64, AXES)
    """Shape (m, 3)."""
    odom_from_link_wxyz: Array = column(np.float64, WXYZ)
    """Shape (m, 4)."""


@dataclass(frozen=True)
class StateTable(Table):
    """Every state message, n rows."""

    robot_stamp_ns: Ints = column(np.int64)
    """When the joints were sampled, robot clock. Shape (n,)."""
    host_stamp_ns: Ints = column(np.int64)
    """When the message was received, host clock. Shape (n,)."""
    sequence: Ints = column(np.int64)
    """Number of the message, counted from 0; a gap is a message lost between the loop and the log. Shape (n,)."""
    position_rad: Array = column(np.float64, "joints")
    """Shape (n, J)."""
    velocity_rad_s: Array = column(np.float64, "joints")
    """Shape (n, J)."""
    load_nm: Array = column(np.float64, "joints")
    """Shape (n, J)."""
    position_of_body_in_odom_m: Array = column(np.float64, AXES)
    """Shape (n, 3)."""
    odom_from_body_wxyz: Array = column(np.float64, WXYZ)
    """Shape (n, 4)."""
    linear_vel_of_body_in_odom_m_s: Array = column(np.float64, AXES)
    """Shape (n, 3)."""
    angular_vel_of_body_in_odom_rad_s: Array = column(np.float64, AXES)
    """Shape (n, 3)."""
    foot_contact: NDArray[np.bool_] = column(np.bool_, "feet")
    """Shape (n, F), or (n, 0) where the source has none."""
    last_command_key: Ints = column(np.int64)
    """Newest command that the robot had received; 0 before the first. Shape (n,)."""
    last_command_robot_stamp_ns: Ints = column(np.int64)
    """When it had, robot clock; 0 before the first. Shape (n,)."""
    imu: ImuTable = dataclasses.field(default_factory=lambda: ImuTable.of(0, {}))

    def rows(self, index: NDArray[Any] | slice) -> Self:
        """The rows of ``index``, with the packets of the inertial unit that they carried."""
        chosen = np.arange(len(self))[index]
        new_row = np.full(len(self), -1, dtype=np.int64)
        new_row[chosen] = np.arange(len(chosen))
        carried = new_row[self.imu.state_index]
        imu = dataclasses.replace(self.imu, state_index=carried).rows(carried >= 0)
        return dataclasses.replace(self, imu=imu, **{name: getattr(self, name)[chosen] for name in self.columns()})


@dataclass(frozen=True)
class CommandTable(Table):
    """Every command sent, n rows; stamps and set-points as in :class:`~spot_log.format.records.CommandRecord`."""

    key: Ints = column(np.int64)
    host_stamp_ns: Ints = column(np.int64)
    robot_stamp_ns: Ints = column(np.int64)
    state_robot_stamp_ns: Ints = column(np.int64)
    end_robot_stamp_ns: Ints = column(np.int64)
    requested_position_rad: Array = column(np.float64, "joints")
    """Shape (n, J), like all that follow."""
    position_rad: Array = column(np.float64, "joints")
    velocity_rad_s: Array = column(np.float64, "joints")
    load_nm: Array = column(np.float64, "joints")
    kp_nm_per_rad: Array = column(np.float64, "joints")
    kd_nm_s_per_rad: Array = column(np.float64, "joints")


@dataclass(frozen=True)
class TickTable(Table):
    """Every policy tick, n rows; fields as in :class:`~spot_log.format.records.TickRecord`."""

    index: Ints = column(np.int64)
    robot_stamp_ns: Ints = column(np.int64)
    host_stamp_ns: Ints = column(np.int64)
    mode: NDArray[np.str_] = column(np.str_)
    observation: NDArray[np.float32] = column(np.float32, "#")
    """Shape (n, 48); NaN where the tick ran no policy."""
    action: NDArray[np.float32] = column(np.float32, "joints")
    """Shape (n, J); NaN where the tick ran no policy."""
    velocity_command: Array = column(np.float64, VELOCITY)
    """V_x, V_y (m/s), ω_z (rad/s). Shape (n, 3)."""
    state_age_s: Array = column(np.float64)
    inference_s: Array = column(np.float64)
    compute_s: Array = column(np.float64)
    command_key: Ints = column(np.int64)
    skipped: Ints = column(np.int64)


@dataclass(frozen=True)
class SlowTable(Table):
    """Every poll of battery, temperatures and faults, n rows."""

    robot_stamp_ns: Ints = column(np.int64)
    host_stamp_ns: Ints = column(np.int64)
    motors_powered: NDArray[np.bool_] = column(np.bool_)
    estopped: NDArray[np.bool_] = column(np.bool_)
    battery_charge_percent: Array = column(np.float64)
    battery_voltage_v: Array = column(np.float64)
    battery_current_a: Array = column(np.float64)
    """Negative while discharging."""
    motor_temperature_c: Array = column(np.float64, "joints")
    """Shape (n, J), in joint order; NaN where the robot reports none."""
    battery_temperature_c: tuple[tuple[float, ...], ...] = ()
    system_faults: tuple[tuple[str, ...], ...] = ()
    behavior_faults: tuple[tuple[str, ...], ...] = ()
    service_faults: tuple[tuple[str, ...], ...] = ()
