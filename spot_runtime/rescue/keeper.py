"""Sees that a control process has a guardian: none, and no robot gets power; one that ends has a successor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from spot_log.write.logger_process import CLOSE_TIMEOUT_S
from spot_model.io.child_process import ChildProcess
from spot_runtime.config import RobotConfig
from spot_runtime.hal.errors import HalError
from spot_runtime.rescue.heartbeat import Heartbeat

CALLS_IN_A_ROW: Final = 4
"""Most calls to the robot between two beats: is there power, power on, stand, does it stand."""
SPARE_S: Final = 5.0
"""For what else a control process does between two beats, such as writing to a slow disk, and for a busy computer."""
WATCHES_WITHIN_S: Final = 20.0
"""It starts within half a second, unless the computer is very busy."""
LOOK_S: Final = 0.02
LEAST_PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 60.0
"""Between two successors. Each costs a process, which a computer that cannot keep one should not start every second."""


def longest_silence_s(robot: RobotConfig) -> float:
    """Without a beat for so long a process hangs: calls just within their time-out and closing a log take longest."""
    return SPARE_S + max(CALLS_IN_A_ROW * robot.rpc_timeout_s, CLOSE_TIMEOUT_S)


class GuardianKeeper:
    """Starts guardians, which share a heartbeat."""

    def __init__(self, start: Callable[[], ChildProcess], heartbeat: Heartbeat, tell: Callable[[str], None]) -> None:
        """With what starts one or raises OSError, what one shows, and what is told in words of each that has ended."""
        self._start, self._heartbeat, self._tell = start, heartbeat, tell
        self._guardian: ChildProcess | None = None
        self._pause_s, self._began_s, self._alive_s = 0.0, 0.0, 0.0

    def begin(self) -> None:
        """Start the first one, and wait until it watches. Raises HalError."""
        try:
            guardian = self._guardian = self._start()
        except OSError as error:
            raise _refusal(str(error)) from error
        for _ in range(round(WATCHES_WITHIN_S / LOOK_S)):
            has_ended = guardian.wait(LOOK_S) is not None
            if self._heartbeat.is_watched:
                return
            if has_ended:
                raise _refusal(f"it ended at once, {guardian.end_in_words}")
        guardian.end(0.0)
        raise _refusal(f"it did not begin within {WATCHES_WITHIN_S:g} s")

    def look(self, now_s: float) -> None:
        """Replace one that has ended: the first at once, further ones after pauses that grow unless one lasts."""
        if self._guardian is not None and self._guardian.exit_code is None:
            self._alive_s = now_s
            return
        if now_s - self._began_s < self._pause_s:
            return
        has_lasted = self._alive_s - self._began_s > LONGEST_PAUSE_S
        self._pause_s = LEAST_PAUSE_S if has_lasted else min(max(2.0 * self._pause_s, LEAST_PAUSE_S), LONGEST_PAUSE_S)
        self._began_s = now_s
        words = "no guardian" if self._guardian is None else f"the guardian has ended ({self._guardian.end_in_words})"
        try:
            self._guardian = self._start()
            words += "; another one was started"
        except OSError as error:
            self._guardian = None
            words += f", and none can be started: {error}; if this program dies, the robot may be left with power"
        self._tell(words)

    def end(self) -> None:
        """End the one that there is: the robot is at rest."""
        if self._guardian is not None:
            self._guardian.end(0.0)


def _refusal(why: str) -> HalError:
    return HalError(
        f"no guardian watches, which would make the robot safe if this program dies: {why}; see to this computer, then "
        "try again"
    )
