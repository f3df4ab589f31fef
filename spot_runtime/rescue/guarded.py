"""A guarded adapter of the vendor's robot: with a note of its lease, and a guardian that is kept alive."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord
from spot_log.write.logger_process import CLOSE_TIMEOUT_S
from spot_log.write.sink import LogSink
from spot_model.process.child_process import ChildProcess
from spot_model.robot.state import RobotState
from spot_runtime.config import RobotConfig, RunConfig
from spot_runtime.hal.address import Address, parse_address
from spot_runtime.hal.base import Hal
from spot_runtime.hal.errors import HalError, LeaseHeldError
from spot_runtime.hal.registry import Adapter, HalRequest
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.pace import Pace
from spot_runtime.host.clock import HostClock
from spot_runtime.rescue.guardian import Heartbeat, Hold, start_guardian
from spot_runtime.rescue.lease_note import HeldNote, LeaseNote, LeaseNoteError, note_folder, note_path
from spot_runtime.stops import Stop, StopReason

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
"""Period of :meth:`GuardianKeeper.look`, s."""
LASTS_S: Final = 60.0
MOST_ENDS: Final = 5
"""Number of guardians that may end in a row, none of which lasted."""


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
        """Prepare. ``start`` starts one that sees the heartbeat, or raises OSError; ``tell`` hears of each that ended.

        ``give_up`` is told once, when the robot must not keep its power for want of one.
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


class NotingHal(BosdynHal):
    """Keeps the protocol; a process that dies while it holds the lease leaves a note for ``spot-rl make-safe``."""

    def __init__(
        self,
        address: Address,
        config: RunConfig,
        sink: LogSink,
        pace: Pace | None,
        *,
        folder: Path,
        guardian: Callable[[LeaseNote, Heartbeat], ChildProcess] | None = None,
        on_pause: Callable[[], None] = lambda: None,
        tell: Callable[[EventRecord], None] = lambda _: None,
    ) -> None:
        """As its parent; notes lie in ``folder``, and the rest is as :func:`guarded` has it."""
        super().__init__(address, config, sink, pace, tell=tell)
        self._on_pause, self._start_guardian = on_pause, guardian
        self._guardian: GuardianKeeper | None = None
        self._heartbeat = Heartbeat.new()
        self._robot, self._path = str(address), note_path(str(address), folder)
        self._note: HeldNote | None = None

    def stand(self) -> None:
        """See the protocol. The note is there, and a guardian watches, before the motors have power."""
        note = self._new_note()
        if note is not None:
            try:
                self._note = self._note or HeldNote.write(self._path, note)
            except LeaseNoteError as error:
                raise HalError(str(error)) from error
            if self._guardian is None and self._start_guardian is not None:
                self._guard(partial(self._start_guardian, note, self._heartbeat))
        self._heartbeat.hold = Hold.IN_HAND
        super().stand()

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """See the protocol."""
        self._heartbeat.beat()
        return super().receive(until_robot_ns, timeout_s)

    def power_off(self) -> None:
        """See the protocol. Where somebody else has the lease, the guardian asks for it from now on."""
        try:
            super().power_off()
        except LeaseHeldError as error:
            if self._guardian is None:
                raise
            raise LeaseHeldError(f"{error}; the guardian stays, and powers it off once the lease is free") from error
        self._heartbeat.hold = Hold.AT_REST

    def _new_note(self) -> LeaseNote | None:
        """A note of the lease that is held, or was; None before there was one."""
        lease = self._session.lease
        if lease is None:
            return None
        return LeaseNote(self._robot, lease.resource, lease.epoch, lease.sequence[0], self._session.token)

    def _lease_taken_up(self) -> None:
        super()._lease_taken_up()
        note = self._new_note()
        if self._note is not None and note is not None:
            with contextlib.suppress(LeaseNoteError):  # the old one leads to the robot, too
                self._note = HeldNote.write(self._path, note, instead_of=self._note)

    def _guard(self, start: Callable[[], ChildProcess]) -> None:
        def tell(text: str) -> None:
            self._occurred(EventName.GUARDIAN_LOST, text)

        def give_up(text: str) -> None:
            self._problems.append(Stop(StopReason.UNGUARDED, text))

        keeper = GuardianKeeper(start, self._heartbeat, tell, give_up)
        keeper.begin()
        self._guardian = keeper
        # By this computer's clock, which is a guardian's, also where robot time has another pace.
        self._jobs.add("guardian", LOOK_PERIOD_S, lambda: keeper.look(time.monotonic()), now_s=self._pace.chore_now_s())

    def _pause(self, duration_s: float) -> None:
        self._heartbeat.beat()
        self._on_pause()
        super()._pause(duration_s)

    def close(self) -> None:
        """See the protocol. A lease under which the robot could not be powered off is not given back.

        It goes stale in some seconds, and then the robot acts by itself, or ``make-safe`` does.
        """
        is_at_rest = self._heartbeat.hold is Hold.AT_REST
        if not is_at_rest:
            self._heartbeat.hold = Hold.LET_GO
            if self._note is not None:
                self._session.has_lease = False
        super().close()
        self._heartbeat.beat()
        note, self._note = self._note, None
        if note is not None:
            note.remove() if is_at_rest else note.let_go()
        if self._guardian is not None and is_at_rest:
            self._guardian.end()


def guarded(
    adapter: Adapter,
    request: HalRequest,
    *,
    service_pid: int = 0,
    on_pause: Callable[[], None] = lambda: None,
    tell: Callable[[EventRecord], None] = lambda _: None,
) -> Callable[[LogSink], Hal]:
    """What makes the adapter, guarded where it is the vendor's; any other is as it is, and its robot on its own.

    The operator's service, if its process is given, acts before the guardian does. ``on_pause`` is told of each look at
    a motion of the vendor's, ``tell`` of every event, and must not block.
    """
    if request.config.robot.hal != "spot":
        return adapter.make
    address, folder = parse_address(request.robot), note_folder(os.environ)

    def guardian(note: LeaseNote, heartbeat: Heartbeat) -> ChildProcess:
        return start_guardian(
            str(address),
            request.config,
            folder,
            control_pid=os.getpid(),
            heartbeat=heartbeat,
            silent_s=longest_silence_s(request.config.robot),
            note=note,
            service_pid=service_pid,
            lock_step=request.lock_step,
        )

    def make(sink: LogSink) -> Hal:
        pace = LockStep(request.lock_step, HostClock().now_ns()) if request.lock_step else None
        return NotingHal(
            address, request.config, sink, pace, folder=folder, guardian=guardian, on_pause=on_pause, tell=tell
        )

    return make
