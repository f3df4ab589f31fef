"""Falls: a body that is tilted too far, or lies on the ground while it should be up."""

from __future__ import annotations

import math

from fake_robot.body.body import Body
from fake_robot.network.status import Mode

_LYING_BODY_M = 0.2
_LYING_S = 0.25
_TILT_COUNTS = (Mode.STANDING_UP, Mode.STANDING, Mode.STEPPING, Mode.FROZEN, Mode.WALKING, Mode.JOINT_CONTROL)
_LYING_COUNTS = (Mode.STANDING, Mode.STEPPING, Mode.WALKING, Mode.JOINT_CONTROL)


class FallWatch:
    """Looks at the body once a state message. Times are nanoseconds of robot time since the start."""

    def __init__(self, body: Body, fall_tilt_rad: float) -> None:
        self._body, self._fall_tilt_rad = body, fall_tilt_rad
        self._lying_since_ns: int | None = None

    def reset(self) -> None:
        """Another mode begins."""
        self._lying_since_ns = None

    def why_fallen(self, mode: Mode, now_ns: int) -> str | None:
        """What makes this a fall; None while the robot is up, or need not be."""
        if mode not in _TILT_COUNTS:
            self.reset()
            return None
        tilt_rad = self._body.tilt_rad()
        if tilt_rad > self._fall_tilt_rad:
            return f"the body is tilted by {math.degrees(tilt_rad):.0f} degrees"
        if mode in _LYING_COUNTS and self._has_lain(now_ns):
            return "the body lies on the ground"
        return None

    def _has_lain(self, now_ns: int) -> bool:
        if not (self._body.height_m() < _LYING_BODY_M and self._body.is_lying()):
            self._lying_since_ns = None
            return False
        if self._lying_since_ns is None:
            self._lying_since_ns = now_ns
        return (now_ns - self._lying_since_ns) * 1e-9 > _LYING_S
