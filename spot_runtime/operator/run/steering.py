"""What an operator does to a running robot: steer it, and be there.

Two timers, both by the host's clock as the loop reads it. The dead-man: without a new velocity for ``deadman_s`` the
command fades to zero and the robot stands in place. Attendance: without any sign of any operator for
``attendance_s`` the run ends, because a robot must not be left unattended.
"""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import NS_PER_S, Array
from spot_runtime.config import RunConfig
from spot_runtime.sources import Shaper, Wanted
from spot_runtime.stops import Stop, StopReason


class OperatorSource:
    """A source of velocity commands that holds the newest one, as long as it is fresh."""

    name = "operator"

    def __init__(self, config: RunConfig) -> None:
        self._shaper = Shaper(config.operator.acceleration_m_s2, config.operator.release_s)
        self._deadman_ns = round(config.service.deadman_s * NS_PER_S)
        self._wanted: Array | None = None
        self._set_ns = 0

    def steer(self, wanted: Array, host_stamp_ns: int) -> None:
        """Take a velocity: V_x, V_y (m/s), ω_z (rad/s), shape (3,)."""
        self._wanted, self._set_ns = wanted, host_stamp_ns

    def let_go(self) -> None:
        """Forget the velocity; the command fades at once."""
        self._wanted = None

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """See the protocol. It never finishes by itself."""
        del active_s
        if self._wanted is not None and host_stamp_ns - self._set_ns > self._deadman_ns:
            self._wanted = None
        return Wanted(np.asarray(self._shaper.follow(self._wanted, host_stamp_ns)))

    def close(self) -> None:
        """Nothing is held."""


class Attendance:
    """Whether somebody is there."""

    def __init__(self, config: RunConfig, host_stamp_ns: int) -> None:
        """An operator is there now: somebody asked to arm."""
        self._bound_ns = round(config.service.attendance_s * NS_PER_S)
        self._seen_ns = host_stamp_ns

    def seen(self, host_stamp_ns: int) -> None:
        """An operator gave a sign."""
        self._seen_ns = max(self._seen_ns, host_stamp_ns)

    def check(self, host_stamp_ns: int) -> Stop | None:
        """The stop that is due when nobody is there."""
        silent_ns = host_stamp_ns - self._seen_ns
        if silent_ns <= self._bound_ns:
            return None
        values = {"silent_s": silent_ns / NS_PER_S, "bound_s": self._bound_ns / NS_PER_S}
        return Stop(StopReason.OPERATOR_GONE, "", values)
