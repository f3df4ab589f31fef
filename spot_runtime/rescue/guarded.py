"""An adapter of the vendor's robot that is watched over: with a note of its lease, and a guardian that reads it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord
from spot_log.write.sink import LogSink
from spot_model.io.child_process import ChildProcess
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig
from spot_runtime.hal.base import Hal
from spot_runtime.hal.connection.address import Address, parse_address
from spot_runtime.hal.errors import HalError
from spot_runtime.hal.registry import Adapter, HalRequest
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.pace import Pace
from spot_runtime.host.clock import HostClock
from spot_runtime.rescue.guardian import start_guardian
from spot_runtime.rescue.heartbeat import Heartbeat, Hold
from spot_runtime.rescue.keeper import LOOK_PERIOD_S, GuardianKeeper, longest_silence_s
from spot_runtime.rescue.lease_note import HeldNote, LeaseNote, LeaseNoteError, note_folder, note_path
from spot_runtime.stops import Stop, StopReason


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
        lease = self._session.lease
        if lease is not None:
            note = LeaseNote(self._robot, lease.resource, lease.epoch, lease.sequence[0], self._session.token)
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
        """See the protocol."""
        super().power_off()
        self._heartbeat.hold = Hold.AT_REST

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

    Args:
        adapter: The one that was found.
        request: What it is made for.
        service_pid: The operator's service, which acts before the guardian does; 0: there is none.
        on_pause: Told of each look at a motion of the vendor's.
        tell: Also told of every event; must not block.
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
