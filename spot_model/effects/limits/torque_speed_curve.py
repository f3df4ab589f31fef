"""The torque–speed curve of the paper: six numbers that bound torque by speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from array_api_compat import device

from spot_model.effects.base import IdleBox, Memory, Motion, TorqueEffect, parameter
from spot_model.errors import BadInputError
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray

_SOURCE = "the paper's optimised parameters"


@dataclass(frozen=True, kw_only=True)
class TorqueSpeedCurve(TorqueEffect):
    """Torque is bounded by a maximum and a minimum that shrink with speed in the driving quadrants.

    The upper bound is ``torque_max`` up to the speed ``intersect_max``, then falls in a straight line to zero at
    ``speed_max`` and stays there; the lower bound mirrors it with the ``_min`` numbers at negative speeds.
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
