"""Where commands to the policy come from, and how velocities are shaped on the way."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from spot_model.robot.facts import Array


class Wanted(NamedTuple):
    """What the operator wants now."""

    command: Array
    """V_x, V_y (m/s), ω_z (rad/s), shape (3,); for a joint script, offsets of the set-points in rad, shape (12,)."""
    is_finished: bool = False
    """The source has nothing more to say: stop and hand back."""


class CommandSource(Protocol):
    """Asked once a policy tick; never blocks."""

    name: str

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        """The command at this instant: so much robot time after the policy came into full control.

        The host's clock is for dead-man timers.
        """

    def close(self) -> None:
        """Give back what is held (a terminal's mode, a device)."""


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
