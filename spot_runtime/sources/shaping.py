"""Making an operator's wishes gentle: commands rise at a bounded rate and fade at once when released."""

from __future__ import annotations

import numpy as np

from spot_model.robot.state import Array


class Shaper:
    """A velocity command that follows wishes."""

    def __init__(self, acceleration: float, release_s: float) -> None:
        """Rise by at most ``acceleration`` per second; fade to zero within ``release_s`` when released."""
        self._acceleration, self._release_s = acceleration, release_s
        self._command: Array = np.zeros(3)
        self._released_from: Array | None = None
        self._released_ns = 0
        self._last_ns: int | None = None

    def follow(self, wanted: Array | None, host_stamp_ns: int) -> Array:
        """The command now: V_x, V_y (m/s), ω_z (rad/s), shape (3,); None is wanted when nobody holds the dead-man."""
        elapsed_s = 0.0 if self._last_ns is None else max(0.0, (host_stamp_ns - self._last_ns) / 1e9)
        self._last_ns = host_stamp_ns
        if wanted is not None:
            self._released_from = None
            largest_step = self._acceleration * min(elapsed_s, 0.1)
            self._command = self._command + np.clip(wanted - self._command, -largest_step, largest_step)
            return self._command
        if self._released_from is None:
            self._released_from, self._released_ns = self._command, host_stamp_ns
        share = 1.0 - (host_stamp_ns - self._released_ns) / 1e9 / self._release_s
        self._command = self._released_from * max(0.0, share)
        return self._command
