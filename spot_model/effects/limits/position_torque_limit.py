"""The knee's torque limit by position: a lead screw with a changing lever arm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from array_api_compat import device

from spot_model.effects.base import IdleBox, Memory, Motion, TorqueEffect, parameter
from spot_model.robot.arrays import namespace_of
from spot_model.robot.knee_table import KNEE_MOTOR_TORQUE_NM, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_RATIO
from spot_model.robot.rotation import AnyArray

_FIRST_RAD = float(KNEE_TABLE_POSITION_RAD[0])
_LAST_RAD = float(KNEE_TABLE_POSITION_RAD[-1])
_INTERVALS = len(KNEE_TABLE_POSITION_RAD) - 1
_IDLE_SHARE = 0.5
_STEP_RAD = (_LAST_RAD - _FIRST_RAD) / _INTERVALS


@dataclass(frozen=True, kw_only=True)
class PositionTorqueLimit(TorqueEffect):
    """Torque is bounded by the motor's torque times the transmission ratio at this knee angle.

    The ratio is interpolated in the 101-row table and held constant beyond its ends.

    Source: Isaac Lab's Spot asset (BSD-3-Clause); 1.5 N·m at the motor.
    """

    name: ClassVar[str] = "position_torque_limit"

    joints: tuple[str, ...] = ("knees",)
    motor_torque_nm: Any = parameter(
        null=math.inf, low=0.05, high=10.0, unit="N·m", source=f"Isaac Lab: {KNEE_MOTOR_TORQUE_NM} N·m"
    )

    def start(self, torque_nm: AnyArray) -> Memory:
        """The table as arrays like ``torque_nm``, so that no step copies it."""
        xp = namespace_of(torque_nm)
        number = {"dtype": torque_nm.dtype, "device": device(torque_nm)}
        ratio = np.abs(KNEE_TABLE_RATIO)
        return _Table(
            ratio=xp.asarray(ratio[:-1], **number),
            rise=xp.asarray(np.diff(ratio), **number),
            zero=xp.zeros((1, 1), **number),
            last=xp.full((1, 1), float(_INTERVALS), **number),
            last_start=xp.full((1, 1), float(_INTERVALS - 1), **number),
        )

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Clip to ± the limit at this position."""
        xp = namespace_of(torque_nm)
        limit = self.motor_torque_nm * _interpolate(xp, motion.position_rad, memory)
        return xp.minimum(xp.maximum(torque_nm, -limit), limit), memory

    def idle_box(self) -> IdleBox:
        """Below half of the greatest limit, at the angles where it is at least that."""
        ratio = np.abs(KNEE_TABLE_RATIO)
        enough = np.flatnonzero(ratio >= _IDLE_SHARE * ratio.max())
        angles = KNEE_TABLE_POSITION_RAD[enough[[0, -1]]]
        torque = 0.999 * _IDLE_SHARE * self.motor_torque_nm * float(ratio.max())
        return IdleBox(torque_nm=(-torque, torque), position_rad=(float(angles.min()), float(angles.max())))


class _Table(NamedTuple):
    """Ratio at the start of each of the table's intervals and its rise over it; then bounds of a row number."""

    ratio: AnyArray
    rise: AnyArray
    zero: AnyArray
    last: AnyArray
    last_start: AnyArray


def _interpolate(xp: Any, position_rad: AnyArray, table: _Table) -> AnyArray:
    """Magnitude of the knee's transmission ratio at an angle, shape of ``position_rad``."""
    row = (position_rad - _FIRST_RAD) * (1.0 / _STEP_RAD)
    row = xp.where(row == row, row, table.zero)
    row = xp.minimum(xp.maximum(row, table.zero), table.last)
    below = xp.minimum(xp.floor(row), table.last_start)
    index = xp.astype(below, xp.int64)
    return table.ratio[index] + (row - below) * table.rise[index]
