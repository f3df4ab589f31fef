"""A process that outlives the one in control, and makes the robot safe if no other process does.

It is started before the motors get power, and sleeps. A control process that hangs is aborted, then killed. When it is
gone without having brought the robot to rest, the operator's service has its turn, if it lives; then this one asks the
robot, and does what is left to do, however long another client has the lease. It knows the lease by itself: a note that
somebody deletes is not missed.
"""

from __future__ import annotations

import contextlib
import json
import math
import mmap
import os
import signal
import sys
import time
import weakref
from collections.abc import Callable, Collection
from dataclasses import asdict
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from spot_model.errors import SpotRlError
from spot_model.process.child_process import HEARD, LOOK_PERIOD_S, ChildProcess, LivingProcess

if TYPE_CHECKING:
    from spot_runtime.config import RunConfig
    from spot_runtime.rescue.lease_note import LeaseNote


_COUNT: Final = 0
_HOLD: Final = 1
_LOOKS: Final = 2
_BYTES: Final = 3


class Hold(IntEnum):
    """What the process in control has of the robot."""

    IN_HAND = 0
    """It must beat."""
    LET_GO = 1
    """It is done with the robot, which may have power; it must still end, or beat."""
    AT_REST = 2
    """The robot has no power: nothing is left to do."""


class Heartbeat:
    """Shared bytes: a count that rises while the process works, what it has of the robot, and whether it is watched."""

    def __init__(self, descriptor: int) -> None:
        """Share the memory of a descriptor, which is closed with this object."""
        self.descriptor = descriptor
        weakref.finalize(self, os.close, descriptor)
        self._shared = mmap.mmap(descriptor, _BYTES)

    @staticmethod
    def new() -> Heartbeat:
        """One that nobody shares yet. Raises OSError."""
        descriptor = os.memfd_create("heartbeat")
        os.ftruncate(descriptor, _BYTES)
        return Heartbeat(descriptor)

    def beat(self) -> None:
        """The process works."""
        self._shared[_COUNT] = (self._shared[_COUNT] + 1) & 0xFF

    @property
    def count(self) -> int:
        """Number of beats, modulo 256."""
        return self._shared[_COUNT]

    @property
    def hold(self) -> Hold:
        """What was last reported."""
        return Hold(self._shared[_HOLD])

    @hold.setter
    def hold(self, hold: Hold) -> None:
        self._shared[_HOLD] = hold

    @property
    def looks(self) -> int:
        """How often a guardian has looked, 1 to 255 and again; 0: none has begun to watch."""
        return self._shared[_LOOKS]

    @looks.setter
    def looks(self, looks: int) -> None:
        self._shared[_LOOKS] = looks

    def look(self) -> None:
        """A guardian watches."""
        self.looks = self.looks % 255 + 1


MODULE: Final = "spot_runtime.rescue.guardian"
ABORT_TAKES_S: Final = 2.0
SERVICE_TURN_S: Final = 5.0
"""The service acts within a second of the end of its control process, unless it hangs."""

OTHERS_TURN_S: Final = 60.0
"""Within this time, any other program that holds the note has finished, or it waits as this one would."""


def start_guardian(
    robot: str,
    config: RunConfig,
    folder: Path,
    *,
    control_pid: int,
    heartbeat: Heartbeat,
    silent_s: float,
    note: LeaseNote,
    service_pid: int = 0,
    lock_step: str = "",
) -> ChildProcess:
    """Start one that watches the process in control, whose note lies in ``folder``. Raises OSError.

    That process hangs if ``heartbeat`` shows no beat for ``silent_s``. The operator's service, if there is one, comes
    first. ``lock_step`` is the admin address of a fake robot whose time stands still while nobody controls it.
    """
    watch = {
        "control_pid": control_pid,
        "service_pid": service_pid,
        "heartbeat": heartbeat.descriptor,
        "silent_s": silent_s,
        "may_be_silent": [Hold.AT_REST, *([Hold.IN_HAND] if lock_step else [])],
        "note": asdict(note),
    }
    told = _told(robot, config, folder, lock_step) | watch
    return ChildProcess.start(
        MODULE, told=json.dumps(told).encode(), descriptors=(heartbeat.descriptor,), has_own_session=True
    )


def start_rescuer(robot: str, config: RunConfig, folder: Path, *, lock_step: str = "") -> ChildProcess:
    """Start one that acts at once on the note of a process that is gone; what it did is heard. Raises OSError."""
    told = json.dumps(_told(robot, config, folder, lock_step)).encode()
    return ChildProcess.start(MODULE, told=told, output=HEARD, has_own_session=True)


def _told(robot: str, config: RunConfig, folder: Path, lock_step: str) -> dict[str, Any]:
    text = config.model_dump_json(by_alias=True)
    from spot_runtime.hal.credentials import told_credentials

    login = told_credentials(os.environ)
    return {"robot": robot, "config": text, "folder": str(folder), "lock_step": lock_step, "login": login}


def main() -> None:
    """Watch, and act if need be."""
    # A signal that ends a run goes to all its processes; this one acts afterwards.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    told = json.loads(sys.stdin.buffer.read())
    os.environ.update(told["login"])
    is_heard = "note" not in told
    if not is_heard and not _is_left_to_us(told):
        return
    from spot_runtime.config import RunConfig
    from spot_runtime.rescue.lease_note import WITHIN_S, LeaseNote
    from spot_runtime.rescue.make_safe import make_safe_by_note, when_new

    def say(words: str) -> None:
        with contextlib.suppress(OSError):
            print(words, file=sys.stdout if is_heard else sys.stderr, flush=True)

    config, folder = RunConfig.model_validate_json(told["config"]), Path(told["folder"])
    known = None if is_heard else LeaseNote(**told["note"])
    code = 0
    try:
        words = make_safe_by_note(
            told["robot"],
            config,
            folder,
            lock_step=told["lock_step"],
            within_s=WITHIN_S,
            known=known,
            tell=say if is_heard else when_new(say),
        )
    except SpotRlError as error:
        words, code = str(error), error.exit_code
    say(words)
    raise SystemExit(code)


def _is_left_to_us(told: dict[str, Any]) -> bool:
    """Wait for the end of the control process, and for others who act. Returns whether it left a robot with power."""
    control, service = LivingProcess(told["control_pid"]), LivingProcess(told["service_pid"])
    heartbeat = Heartbeat(told["heartbeat"])
    outlive(control, heartbeat, told["silent_s"], told["may_be_silent"])
    if heartbeat.hold is Hold.AT_REST:
        return False
    from spot_runtime.rescue.lease_note import is_held, note_path

    note = note_path(told["robot"], Path(told["folder"]))
    _wait_while(lambda: note.exists() and not service.has_ended(), SERVICE_TURN_S)
    _wait_while(lambda: is_held(note) and not service.has_ended())  # it sees to it that its rescuer does not hang
    _wait_while(lambda: is_held(note), OTHERS_TURN_S)
    return True


def outlive(
    control: LivingProcess, heartbeat: Heartbeat, silent_s: float, may_be_silent: Collection[int] = (Hold.AT_REST,)
) -> None:
    """Wait for the end of a process; one that does not beat for ``silent_s`` though it must is aborted, then killed.

    Looks are counted, not seconds: while a computer sleeps, nobody looks. Letting the robot go counts as a beat;
    ``may_be_silent`` are holds in which it need not beat.
    """
    last, silent, is_ending = (heartbeat.count, heartbeat.hold), 0, False
    heartbeat.look()
    while not control.has_ended(LOOK_PERIOD_S):
        heartbeat.look()
        now = heartbeat.count, heartbeat.hold
        beats = now != last or heartbeat.hold in may_be_silent
        last, silent = now, 0 if beats and not is_ending else silent + 1
        if silent * LOOK_PERIOD_S > silent_s + 2.0 * ABORT_TAKES_S:
            return  # it waits for a disk, and not even that signal ends it
        if silent * LOOK_PERIOD_S > silent_s + ABORT_TAKES_S:
            control.send(signal.SIGKILL)
        elif silent * LOOK_PERIOD_S > silent_s and not is_ending:
            is_ending = True
            control.send(signal.SIGABRT)


def _wait_while(is_so: Callable[[], bool], longest_s: float = math.inf) -> None:
    waited_s = 0.0
    while waited_s < longest_s and is_so():
        time.sleep(LOOK_PERIOD_S)
        waited_s += LOOK_PERIOD_S


if __name__ == "__main__":
    main()
