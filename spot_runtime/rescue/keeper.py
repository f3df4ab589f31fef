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
UNGUARDED_S: Final = 10.0
"""A robot with power that nobody has guarded for so long sits down. A guardian begins to watch within half a second."""
HANGS_S: Final = 2.0
"""A guardian that watched, and was not seen to look for so long, is killed. It looks five times a second."""
LOOK_PERIOD_S: Final = 1.0
"""Of :meth:`GuardianKeeper.look`."""
LASTS_S: Final = 60.0
MOST_ENDS: Final = 5
"""So many guardians may end in a row, none of which lasted."""


def longest_silence_s(robot: RobotConfig) -> float:
    """Without a beat for so long a process hangs: calls just within their time-out and closing a log take longest."""
    return SPARE_S + max(CALLS_IN_A_ROW * robot.rpc_timeout_s, CLOSE_TIMEOUT_S)


class GuardianKeeper:
    """Starts guardians, which share a heartbeat."""

    def __init__(
        self,
        start: Callable[[], ChildProcess],
        heartbeat: Heartbeat,
        tell: Callable[[str], None],
        give_up: Callable[[str], None],
    ) -> None:
        """Prepare.

        Args:
            start: Starts one or raises OSError.
            heartbeat: What one shows.
            tell: Told in words of each that has ended.
            give_up: Told once, when the robot must not keep its power for want of one.
        """
        self._start, self._heartbeat, self._tell, self._give_up = start, heartbeat, tell, give_up
        self._guardian: ChildProcess | None = None
        self._began_s, self._looks, self._ends, self._has_given_up = 0.0, 0, 0, False
        self._missed_s: float | None = None
        """When one was last seen to watch; None while one is."""

    def begin(self) -> None:
        """Start the first one, and wait until it watches. Raises HalError."""
        try:
            guardian = self._guardian = self._start()
        except OSError as error:
            raise _refusal(str(error)) from error
        for _ in range(round(WATCHES_WITHIN_S / LOOK_S)):
            has_ended = guardian.wait(LOOK_S) is not None
            if self._heartbeat.looks:
                return
            if has_ended:
                raise _refusal(f"it ended at once, {guardian.end_in_words}")
        guardian.end(0.0)
        raise _refusal(f"it did not begin within {WATCHES_WITHIN_S:g} s")

    def look(self, now_s: float) -> None:
        """Replace one that has ended or hangs, or give up; call it each :data:`LOOK_PERIOD_S`."""
        guardian, looks = self._guardian, self._heartbeat.looks
        is_there = guardian is not None and guardian.exit_code is None
        if is_there and looks not in (0, self._looks):
            self._looks, self._missed_s = looks, None
            self._ends = 0 if now_s - self._began_s > LASTS_S else self._ends
            return
        # Not since the last look, which is long ago where this process itself was stopped.
        self._missed_s = now_s - LOOK_PERIOD_S if self._missed_s is None else self._missed_s
        unguarded_s = now_s - self._missed_s
        if guardian is None:
            self._replace(now_s, "no guardian")
        elif not is_there:
            self._replace(now_s, f"the guardian has ended ({guardian.end_in_words})")
        elif unguarded_s > HANGS_S and looks:
            guardian.kill()
            guardian.wait(LOOK_S)  # reaps it; one that a disk holds runs no more all the same
            self._replace(now_s, f"the guardian hung: it had not looked for {unguarded_s:.1f} s and was killed")
        if not self._has_given_up and (unguarded_s > UNGUARDED_S or self._ends > MOST_ENDS):
            self._has_given_up = True
            self._give_up(f"{self._ends} ended in a row, and nobody has watched for {unguarded_s:.0f} s")

    def _replace(self, now_s: float, words: str) -> None:
        self._ends += self._guardian is not None
        self._began_s, self._looks, self._heartbeat.looks = now_s, 0, 0
        try:
            self._guardian = self._start()
            words += "; another one was started"
        except OSError as error:
            self._guardian = None
            words += f", and none can be started: {error}; if this program dies, the robot may be left with power"
        if not self._has_given_up:
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
