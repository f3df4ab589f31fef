"""The torque–speed curve of the paper: six numbers that bound torque by speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from array_api_compat import array_namespace

from spot_model.effects.base import Memory, Motion, TorqueEffect, parameter
from spot_model.errors import BadInputError
from spot_model.rotation import AnyArray

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

    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Clip to the bounds at this speed."""
        xp = array_namespace(torque_nm)
        high, low = self.bounds_nm(motion.velocity_rad_s)
        return xp.minimum(xp.maximum(torque_nm, low), high), memory

    def bounds_nm(self, velocity_rad_s: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Upper and lower torque bound at a speed, shape of ``velocity_rad_s`` (broadcast), N·m."""
        high = _bound(self.torque_max_nm, self.speed_max_rad_s, self.intersect_max_rad_s, velocity_rad_s)
        low = _bound(-self.torque_min_nm, -self.speed_min_rad_s, -self.intersect_min_rad_s, -velocity_rad_s)
        return high, -low


def _bound(stall_nm: AnyArray, no_load_rad_s: AnyArray, corner_rad_s: AnyArray, speed_rad_s: AnyArray) -> AnyArray:
    xp = array_namespace(speed_rad_s)
    limited = xp.isfinite(no_load_rad_s)
    span = xp.where(limited, no_load_rad_s - corner_rad_s, xp.ones_like(corner_rad_s))
    room = xp.where(limited, no_load_rad_s, xp.ones_like(no_load_rad_s)) - xp.where(
        limited, speed_rad_s, xp.zeros_like(speed_rad_s)
    )
    fraction = xp.clip(room / xp.maximum(span, xp.full_like(span, 1e-9)), 0.0, 1.0)
    return xp.where(limited, xp.where(limited, stall_nm, xp.zeros_like(stall_nm)) * fraction, stall_nm)
