"""Bounds on a joint's torque: flat, by speed, and by position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from array_api_compat import device

from spot_model.effects.base import IdleBox, Memory, Motion, TorqueEffect, parameter
from spot_model.errors import BadInputError
from spot_model.robot.arrays import namespace_of
from spot_model.robot.facts import KNEE_MOTOR_TORQUE_NM, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_RATIO
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class TorqueLimit(TorqueEffect):
    """Torque saturates at ± a constant.

    Source: the SDK's hip limit, 45 N·m.
    """

    name: ClassVar[str] = "torque_limit"

    limit_nm: Any = parameter(null=math.inf, low=1.0, high=500.0, unit="N·m", source="SDK: hips 45 N·m")

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Clip to ± the limit."""
        xp = namespace_of(torque_nm)
        return xp.minimum(xp.maximum(torque_nm, -self.limit_nm), self.limit_nm), memory

    def idle_box(self) -> IdleBox:
        """Up to the limit."""
        return IdleBox(torque_nm=(-self.limit_nm, self.limit_nm))


_SOURCE = "the paper's optimised parameters"


@dataclass(frozen=True, kw_only=True)
class TorqueSpeedCurve(TorqueEffect):
    """Torque is bounded by a maximum and a minimum that shrink with speed in the driving quadrants.

    The upper bound is ``torque_max`` up to the speed ``intersect_max``, then falls in a straight line to zero at
    ``speed_max`` and stays there. The lower bound mirrors it with the ``_min`` numbers at negative speeds.
    Braking torque keeps the full bound.

    Source: the paper, torque–speed limits with six parameters (+97.00/−108.79 N·m, +25.03/−22.22 rad/s, intersects
    +9.48/−8.32 rad/s identified for the knees).
    """

    name: ClassVar[str] = "torque_speed_curve"

    torque_max_nm: Any = parameter(null=math.inf, low=0.0, high=500.0, unit="N·m", source=_SOURCE)
    torque_min_nm: Any = parameter(null=-math.inf, low=-500.0, high=0.0, unit="N·m", source=_SOURCE)
    speed_max_rad_s: Any = parameter(null=math.inf, low=0.1, high=200.0, unit="rad/s", source=_SOURCE)
    speed_min_rad_s: Any = parameter(null=-math.inf, low=-200.0, high=-0.1, unit="rad/s", source=_SOURCE)
    intersect_max_rad_s: Any = parameter(null=0.0, low=0.0, high=200.0, unit="rad/s", source=_SOURCE)
    intersect_min_rad_s: Any = parameter(null=0.0, low=-200.0, high=0.0, unit="rad/s", source=_SOURCE)

    def check(self) -> None:
        """An intersect beyond its speed limit, or a speed limit without a torque bound, has no meaning."""
        for side, sign in (("max", 1.0), ("min", -1.0)):
            torque, speed, intersect = (
                getattr(self, f"{kind}_{side}_{unit}")
                for kind, unit in (("torque", "nm"), ("speed", "rad_s"), ("intersect", "rad_s"))
            )
            if not all(isinstance(v, (int, float, np.ndarray)) for v in (torque, speed, intersect)):
                continue
            if np.any(sign * np.asarray(intersect) > sign * np.asarray(speed)):
                raise BadInputError(
                    f"{self.name}.intersect_{side}_rad_s = {intersect} lies beyond "
                    f"speed_{side}_rad_s = {speed}; allowed: between 0 and the speed limit"
                )
            if np.any(np.isfinite(speed) & ~np.isfinite(torque)):
                raise BadInputError(
                    f"{self.name}.speed_{side}_rad_s = {speed} is set without torque_{side}_nm; give both"
                )

    def start(self, torque_nm: AnyArray) -> Memory:
        """What depends on the parameters alone, so that no step computes it again."""
        return self._lines(torque_nm)

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Clip to the bounds at this speed."""
        xp = namespace_of(torque_nm)
        high, low = self._bounds_nm(xp, motion.velocity_rad_s, memory)
        return xp.minimum(xp.maximum(torque_nm, low), high), memory

    def idle_box(self) -> IdleBox:
        """Up to the bounds at rest, below the speeds at which they begin to fall."""
        # A little less than the speeds, as the falling line may round to just below 1 there.
        return IdleBox(
            torque_nm=(self.torque_min_nm, self.torque_max_nm),
            velocity_rad_s=(
                0.999 * self.intersect_min_rad_s if math.isfinite(self.speed_min_rad_s) else -math.inf,
                0.999 * self.intersect_max_rad_s if math.isfinite(self.speed_max_rad_s) else math.inf,
            ),
        )

    def _lines(self, like: AnyArray) -> _Lines:
        xp = namespace_of(like)
        number = {"dtype": like.dtype, "device": device(like)}
        return _Lines(
            *_line(xp, self.speed_max_rad_s, self.intersect_max_rad_s),
            *_line(xp, -self.speed_min_rad_s, -self.intersect_min_rad_s),
            zero=xp.zeros((1, 1), **number),
            one=xp.ones((1, 1), **number),
        )

    def _bounds_nm(self, xp: Any, velocity_rad_s: AnyArray, lines: _Lines) -> tuple[AnyArray, AnyArray]:
        up = lines.start_max - lines.slope_max_s_per_rad * velocity_rad_s
        down = lines.start_min + lines.slope_min_s_per_rad * velocity_rad_s
        high = self.torque_max_nm * xp.minimum(xp.maximum(up, lines.zero), lines.one)
        low = self.torque_min_nm * xp.minimum(xp.maximum(down, lines.zero), lines.one)
        return high, low


class _Lines(NamedTuple):
    """The falling lines as a share of the bound at rest: start − slope·speed, later held between 0 and 1."""

    start_max: AnyArray
    slope_max_s_per_rad: AnyArray
    start_min: AnyArray
    slope_min_s_per_rad: AnyArray
    zero: AnyArray
    one: AnyArray


def _line(xp: Any, no_load_rad_s: AnyArray, corner_rad_s: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Start and slope of one line; without a speed limit, 1 and 0."""
    limited = xp.isfinite(no_load_rad_s)
    one = xp.ones_like(no_load_rad_s)
    span = xp.where(limited, no_load_rad_s - corner_rad_s, one)
    # A corner at the limit itself makes the line a step.
    span = xp.maximum(span, xp.full_like(span, 1e-9))
    return xp.where(limited, no_load_rad_s, one) / span, xp.where(limited, one, xp.zeros_like(one)) / span


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
