"""The robot's clock: whole nanoseconds, skewed against the host's and drifting, or standing still until asked."""

from __future__ import annotations

import time
from collections.abc import Callable

from fake_robot.scenario.parts import ClockConfig
from spot_model.robot.facts import NS_PER_S


class RobotClock:
    """Robot time. *Elapsed* time counts from the robot's start; a *stamp* is what the robot's clock shows.

    In real time elapsed time follows the host's monotonic clock, faster or slower by the drift. In lock-step it is what
    the simulation last said it is. Reading is safe from any thread; the rest belongs to the simulation's thread.
    """

    def __init__(
        self,
        config: ClockConfig,
        *,
        is_lock_step: bool,
        host_monotonic_ns: Callable[[], int] = time.monotonic_ns,
        host_unix_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._skew_ns = round(config.skew_s * NS_PER_S)
        self._start_ns = None if config.start_unix_s is None else config.start_unix_s * NS_PER_S
        self._unix_ns = host_unix_ns
        self._epoch_ns = (host_unix_ns() if self._start_ns is None else self._start_ns) + self._skew_ns
        self._rate = 1.0 + config.drift_ppm * 1e-6
        self._monotonic_ns = host_monotonic_ns
        self._is_lock_step = is_lock_step
        # One tuple, replaced as a whole, so that a reader in another thread never sees half a change.
        self._anchor: tuple[int, int] | None = None
        self._simulated_ns = 0

    def now_ns(self) -> int:
        """What the robot's clock shows now."""
        return self.stamp_ns(self.elapsed_ns())

    def stamp_ns(self, elapsed_ns: int) -> int:
        """What the robot's clock shows ``elapsed_ns`` after the start."""
        return self._epoch_ns + elapsed_ns

    def elapsed_ns(self) -> int:
        """Robot time since the start."""
        anchor = self._anchor
        if anchor is None:
            return self._simulated_ns
        host_ns, robot_ns = anchor
        return robot_ns + int((self._monotonic_ns() - host_ns) * self._rate)

    def host_seconds_until(self, elapsed_ns: int) -> float:
        """Host time until robot time reaches ``elapsed_ns``, s; negative when it is past. Real time only."""
        return (elapsed_ns - self.elapsed_ns()) * 1e-9 / self._rate

    # The simulation's side --------------------------------------------------------------------------------------------

    def set_simulated_ns(self, elapsed_ns: int) -> None:
        """Robot time has been simulated up to here."""
        self._simulated_ns = elapsed_ns

    def run(self) -> None:
        """From now on robot time follows the host's clock."""
        if self._is_lock_step:
            return
        if self._start_ns is None:
            # Set-up has taken time; the skew is meant from now on.
            self._epoch_ns = self._unix_ns() + self._skew_ns - self._simulated_ns
        self._anchor = (self._monotonic_ns(), self._simulated_ns)

    def halt(self) -> None:
        """Robot time stands still where the simulation is."""
        self._anchor = None

    def slip(self, lost_ns: int) -> None:
        """Lose robot time: after a stall, the robot's clock is late by this much more."""
        if self._anchor is not None:
            host_ns, robot_ns = self._anchor
            self._anchor = (host_ns, robot_ns - lost_ns)

    def jump(self, by_ns: int) -> None:
        """Set the clock forward or back; elapsed time, and so the robot's motion, is untouched."""
        self._epoch_ns += by_ns
