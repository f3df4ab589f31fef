"""The knee's torque limit by position: a lead screw with a changing lever arm."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from array_api_compat import array_namespace, device

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.knee_table import KNEE_MOTOR_TORQUE_NM, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_RATIO
from spot_model.rotation import AnyArray

_FIRST_RAD = float(KNEE_TABLE_POSITION_RAD[0])
_LAST_RAD = float(KNEE_TABLE_POSITION_RAD[-1])
_INTERVALS = len(KNEE_TABLE_POSITION_RAD) - 1
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
        """The table as an array like ``torque_nm``, so that no step copies it."""
        xp = array_namespace(torque_nm)
        return xp.asarray(np.abs(KNEE_TABLE_RATIO), dtype=torque_nm.dtype, device=device(torque_nm))

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Clip to ± the limit at this position."""
        xp = array_namespace(torque_nm)
        limit = self.motor_torque_nm * interpolate_ratio(motion.position_rad, memory)
        return xp.minimum(xp.maximum(torque_nm, -limit), limit), memory


def interpolate_ratio(position_rad: AnyArray, table: AnyArray) -> AnyArray:
    """Magnitude of the knee's transmission ratio at an angle; ``table`` as made by ``start``. Any shape."""
    xp = array_namespace(position_rad)
    x = xp.clip((position_rad - _FIRST_RAD) / _STEP_RAD, 0.0, float(_INTERVALS))
    below = xp.clip(xp.floor(x), 0.0, float(_INTERVALS - 1))
    index = xp.reshape(xp.astype(below, xp.int64), (-1,))
    low = xp.reshape(xp.take(table, index, axis=0), x.shape)
    high = xp.reshape(xp.take(table, index + 1, axis=0), x.shape)
    return low + (x - below) * (high - low)
