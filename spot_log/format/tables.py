"""The tables of a run: numpy arrays by topic, one row a message, in the order of the file.

A signal that the source lacks is NaN in every row (contacts: no columns). J is the number of joints, F of feet, both
named in the header; for Spot 12 and 4.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray
from typing_extensions import Self

from spot_model.robot.arm import ARM_JOINT_NAMES
from spot_model.robot.facts import Array

AXES: Final = ("x", "y", "z")
WXYZ: Final = ("w", "x", "y", "z")
VELOCITY: Final = ("x_m_s", "y_m_s", "yaw_rad_s")

Parts = tuple[str, ...] | str | None
"""Names of a row's values; ``"joints"`` or ``"feet"``, named in the header; ``"#"``, numbered; None for one value."""


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    dtype: np.dtype[Any]
    parts: Parts

    @property
    def missing(self) -> Any:
        """What stands where the source has nothing: NaN, 0, False or an empty text."""
        return np.nan if self.dtype.kind == "f" else self.dtype.type()


def column(dtype: DTypeLike, parts: Parts = None) -> Any:
    """Declare a dataclass field as a column, shape (n,), or (n, number of ``parts``)."""
    return dataclasses.field(metadata={"column": Column(np.dtype(dtype), parts)})


@dataclass(frozen=True)
class Table:
    """Columns of equal length, one row a message."""

    @classmethod
    @cache
    def columns(cls) -> Mapping[str, Column]:
        """The declared columns by name, in order."""
        return MappingProxyType(
            {f.name: f.metadata["column"] for f in dataclasses.fields(cls) if "column" in f.metadata}
        )

    @classmethod
    def of(cls, n: int, widths: Mapping[str, int], **given: Any) -> Self:
        """A table of ``n`` rows from some of its columns; the others hold what stands for a missing value.

        ``widths`` are of the columns whose parts the header names: ``joints``, ``feet``.
        """
        for name, declared in cls.columns().items():
            if name not in given:
                width = width_of(declared, widths)
                shape = (n,) if width is None else (n, width)
                given[name] = np.full(shape, declared.missing, dtype=declared.dtype)
        return cls(**given)

    def rows(self, index: NDArray[Any] | slice) -> Self:
        """The rows of ``index``: numbers, a mask or a slice."""
        chosen = np.arange(len(self))[index]

        def cut(value: Any) -> Any:
            return value[chosen] if isinstance(value, np.ndarray) else tuple(value[i] for i in chosen)

        return dataclasses.replace(self, **{f.name: cut(getattr(self, f.name)) for f in dataclasses.fields(self)})

    def flat(self, names: Mapping[str, tuple[str, ...]]) -> dict[str, NDArray[Any]]:
        """One named column a scalar: ``name`` or ``name.part``; a signal of another width than its parts is left out.

        ``names`` are those of ``joints`` and ``feet``.
        """
        single, spread = {}, {}
        for name, declared in self.columns().items():
            values = getattr(self, name)
            if declared.parts is None:
                single[name] = values
                continue
            parts = _part_names(declared.parts, names, values.shape[1])
            if len(parts) == values.shape[1]:
                spread.update({f"{name}.{part}": values[:, i] for i, part in enumerate(parts)})
        return {**single, **spread}

    def __len__(self) -> int:
        return len(getattr(self, next(iter(self.columns()))))


def width_of(declared: Column, widths: Mapping[str, int]) -> int | None:
    """Values a row; None for one alone."""
    if declared.parts is None:
        return None
    return widths[declared.parts] if isinstance(declared.parts, str) else len(declared.parts)


def _part_names(parts: tuple[str, ...] | str, names: Mapping[str, tuple[str, ...]], width: int) -> tuple[str, ...]:
    if isinstance(parts, tuple):
        return parts
    return tuple(f"{i:02d}" for i in range(width)) if parts == "#" else names[parts]


Ints = NDArray[np.int64]


@dataclass(frozen=True)
class ImuTable(Table):
    """All packets of the inertial unit, m rows, about three a state."""

    state_index: Ints = column(np.int64)
    """Row of the state that carried the packet. Shape (m,)."""
    robot_stamp_ns: Ints = column(np.int64)
    """When it was measured, robot clock. Shape (m,)."""
    acceleration_of_imu_in_link_m_s2: Array = column(np.float64, AXES)
    """Acceleration of the sensor, in the frame of the link that carries it. Shape (m, 3)."""
    angular_vel_of_link_in_link_rad_s: Array = column(np.float64, AXES)
    """Turning rate of that link, in its own frame. Shape (m, 3)."""
    odom_from_link_wxyz: Array = column(np.float64, WXYZ)
    """Orientation of that link in odom, scalar first. Shape (m, 4)."""


@dataclass(frozen=True)
class ArmTable(Table):
    """The joints of an arm, one row a state; no rows for a robot without one."""

    robot_stamp_ns: Ints = column(np.int64)
    """Stamp of the state, robot clock. Shape (n,)."""
    host_stamp_ns: Ints = column(np.int64)
    """When the state was received, host clock. Shape (n,)."""
    position_rad: Array = column(np.float64, ARM_JOINT_NAMES)
    """Shape (n, 7)."""
    velocity_rad_s: Array = column(np.float64, ARM_JOINT_NAMES)
    """Shape (n, 7)."""
    load_nm: Array = column(np.float64, ARM_JOINT_NAMES)
    """Torque measured at the joints, shape (n, 7)."""


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
    """Measured angle of each joint. Shape (n, J)."""
    velocity_rad_s: Array = column(np.float64, "joints")
    """Measured speed of each joint. Shape (n, J)."""
    load_nm: Array = column(np.float64, "joints")
    """Torque that each joint reports. Shape (n, J)."""
    position_of_body_in_odom_m: Array = column(np.float64, AXES)
    """Position of the body in odom. Shape (n, 3)."""
    odom_from_body_wxyz: Array = column(np.float64, WXYZ)
    """Orientation of the body in odom, scalar first. Shape (n, 4)."""
    linear_vel_of_body_in_odom_m_s: Array = column(np.float64, AXES)
    """Velocity of the body, in the axes of odom. Shape (n, 3)."""
    angular_vel_of_body_in_odom_rad_s: Array = column(np.float64, AXES)
    """Turn rate of the body, in the axes of odom. Shape (n, 3)."""
    foot_contact: NDArray[np.bool_] = column(np.bool_, "feet")
    """Whether each foot is on the ground. Shape (n, F), or (n, 0) where the source has none."""
    last_command_key: Ints = column(np.int64)
    """Key of the newest command that the robot had received; 0 before the first. Shape (n,)."""
    last_command_robot_stamp_ns: Ints = column(np.int64)
    """When it was received, robot clock; 0 before the first. Shape (n,)."""
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
    """Number of the command, which states echo in ``last_command_key``. Shape (n,)."""
    host_stamp_ns: Ints = column(np.int64)
    """When it was handed to the stream, host clock. Shape (n,)."""
    robot_stamp_ns: Ints = column(np.int64)
    """The same instant by the estimated robot clock; 0 where there is no estimate. Shape (n,)."""
    state_robot_stamp_ns: Ints = column(np.int64)
    """Robot stamp of the state that it answers; 0 where it answers none. Shape (n,)."""
    end_robot_stamp_ns: Ints = column(np.int64)
    """When it becomes void, robot clock. Shape (n,)."""
    requested_position_rad: Array = column(np.float64, "joints")
    """What the policy or the ramp asked for, before the limits. Shape (n, J)."""
    position_rad: Array = column(np.float64, "joints")
    """Set-point that was sent: the angle that the joint's servo is told to hold. Shape (n, J)."""
    velocity_rad_s: Array = column(np.float64, "joints")
    """Speed that was sent. Shape (n, J)."""
    load_nm: Array = column(np.float64, "joints")
    """Torque that was sent, on top of the servo's. Shape (n, J)."""
    kp_nm_per_rad: Array = column(np.float64, "joints")
    """Gain of the servo on the angle. Shape (n, J)."""
    kd_nm_s_per_rad: Array = column(np.float64, "joints")
    """Gain of the servo on the speed. Shape (n, J)."""


@dataclass(frozen=True)
class TickTable(Table):
    """Every policy tick, n rows; fields as in :class:`~spot_log.format.records.TickRecord`."""

    index: Ints = column(np.int64)
    """Number of the tick. Shape (n,)."""
    robot_stamp_ns: Ints = column(np.int64)
    """Stamp of the state that the tick saw, robot clock. Shape (n,)."""
    host_stamp_ns: Ints = column(np.int64)
    """When the tick began, host clock. Shape (n,)."""
    mode: NDArray[np.str_] = column(np.str_)
    """Mode of the runtime: ``ramping_in``, ``active``, ``soft_stop``, … Shape (n,)."""
    observation: NDArray[np.float32] = column(np.float32, "#")
    """What the policy saw. Shape (n, 48); NaN where the tick ran no policy."""
    action: NDArray[np.float32] = column(np.float32, "joints")
    """The network's output. Shape (n, J); NaN where the tick ran no policy."""
    velocity_command: Array = column(np.float64, VELOCITY)
    """V_x, V_y (m/s), ω_z (rad/s). Shape (n, 3)."""
    state_age_s: Array = column(np.float64)
    """From the receipt of the state to the start of the tick. Shape (n,)."""
    inference_s: Array = column(np.float64)
    """Time in the network. Shape (n,)."""
    compute_s: Array = column(np.float64)
    """The whole tick, inference included. Shape (n,)."""
    command_key: Ints = column(np.int64)
    """Key of the command that it sent, as in the commands. Shape (n,)."""
    skipped: Ints = column(np.int64)
    """Ticks lost between the one before and this one. Shape (n,)."""


@dataclass(frozen=True)
class SlowTable(Table):
    """Every poll of battery, temperatures and faults, k rows."""

    robot_stamp_ns: Ints = column(np.int64)
    """When the robot answered, robot clock. Shape (k,)."""
    host_stamp_ns: Ints = column(np.int64)
    """When the answer was received, host clock. Shape (k,)."""
    motors_powered: NDArray[np.bool_] = column(np.bool_)
    """Whether the motors have power. Shape (k,)."""
    estopped: NDArray[np.bool_] = column(np.bool_)
    """Whether an e-stop is pressed. Shape (k,)."""
    battery_charge_percent: Array = column(np.float64)
    """Shape (k,)."""
    battery_voltage_v: Array = column(np.float64)
    """Shape (k,)."""
    battery_current_a: Array = column(np.float64)
    """Negative while discharging. Shape (k,)."""
    motor_temperature_c: Array = column(np.float64, "joints")
    """Shape (k, J); NaN where the robot reports none."""
    battery_temperature_c: tuple[tuple[float, ...], ...] = ()
    """Temperature of each cell that the battery reports, for each row."""
    system_faults: tuple[tuple[str, ...], ...] = ()
    """A sentence for each system fault, for each row."""
    behavior_faults: tuple[tuple[str, ...], ...] = ()
    """A sentence for each behaviour fault, for each row."""
    service_faults: tuple[tuple[str, ...], ...] = ()
    """A sentence for each service fault, for each row."""
