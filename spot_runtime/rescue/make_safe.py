"""What is done about a robot whose control process has died: it sits and its motors lose power, if it is still ours.

The robot's own time-outs have ended the motion by then: the last command lapsed 50 ms after it was sent, and the joints
were damped. What is left is a robot that lies or stands with power and without anybody. This process asks the robot
whose lease was the newest. If that is still the dead process's, or nobody has one by now, the robot is told to sit and
to cut power. A lease of anybody else is never touched, and no motion but this one is asked for. As long as somebody
else has the lease and commands nothing, it is asked for again; whoever commands the robot is answerable for it.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Final

from spot_model.errors import SpotRlError
from spot_runtime.config import RunConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.errors import CertificateError, ClockError, CredentialsError, HalError, LeaseHeldError
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from spot_runtime.rescue.lease_note import WITHIN_S, HeldNote, LeaseNote, LeaseNoteError, note_path

RETRY_S: Final = 1.0
"""A link that is down when a process dies is often back in a moment, and a lease may be given back at any time."""


MAY_HAVE_POWER: Final = "THE ROBOT MAY HAVE POWER, see to it"
WAITING: Final = "waiting for the lease: "
"""Begins what is told before the last word."""


class NotSafeError(SpotRlError):
    """The robot may have power, and could not be reached or told."""

    exit_code = 79


class Safety(Enum):
    """How the robot is left."""

    POWERED_OFF = "it sat down and its motors lost power"
    HAD_NO_POWER = "its motors had no power already"
    NOT_OURS = "somebody else has its lease and has commanded it: nothing was done, and they are answerable"


Tell = Callable[[str], None]


def when_new(say: Tell) -> Tell:
    """Say only what was not said just before."""
    last = ""

    def tell(words: str) -> None:
        nonlocal last
        if words != last:
            last = words
            say(words)

    return tell


def make_safe(
    note: LeaseNote, config: RunConfig, *, lock_step: str = "", within_s: float = WITHIN_S, tell: Tell = lambda _: None
) -> Safety:
    """Bring the robot of a note, which the dead process left, to rest, however often that must be tried.

    No new try begins ``within_s`` after the robot last answered; one that is under way takes at most some 30 s more. A
    lease that somebody has without commanding anything is an answer, and ``tell`` is told of each try that ends so.

    Raises:
        NotSafeError: It could not be done.
        SpotRlError: The address or a file is not valid.
    """
    until_s = time.monotonic() + within_s
    while True:
        try:
            return _try(note, config, lock_step)
        except LeaseHeldError as error:
            tell(f"{WAITING}{MAY_HAVE_POWER}: {error}; once it is free, the robot sits down and is powered off")
            until_s = time.monotonic() + within_s
        except HalError as error:
            is_hopeless = isinstance(error, (CertificateError, CredentialsError))
            if is_hopeless or time.monotonic() + RETRY_S > until_s:
                raise NotSafeError(f"{MAY_HAVE_POWER}: {error}") from error
        time.sleep(RETRY_S)


def make_safe_by_note(
    robot: str,
    config: RunConfig,
    folder: Path,
    *,
    lock_step: str,
    within_s: float,
    known: LeaseNote | None = None,
    tell: Tell = lambda _: None,
) -> str:
    """Make one robot safe if there is a note of it. Returns what was done. More as :func:`make_safe` has it.

    ``known`` is what stood in the note, for one that is gone or damaged, or whose holder cannot be ended.

    Raises:
        NotSafeError: It could not be done; the note stays, for the next try.
        SpotRlError: The note cannot be read, its writer lives, or an address or a file is not valid.
    """
    address = str(parse_address(robot))
    try:
        found = HeldNote.find(note_path(address, folder))
    except LeaseNoteError:
        if known is None:
            raise
        found = None
    held, note = found or (None, known)
    if note is None:
        return f"nothing to do: no process of this computer has left {address} with power"
    began_s = time.monotonic()
    try:
        safety = make_safe(note, config, lock_step=lock_step, within_s=within_s, tell=tell)
    except NotSafeError:
        if held is not None:
            held.let_go()
        raise
    if held is not None:
        held.remove()
    verb = "was left to its holder" if safety is Safety.NOT_OURS else "is safe"
    return f"{address} {verb} after {time.monotonic() - began_s:.1f} s: {safety.value}"


def _try(note: LeaseNote, config: RunConfig, lock_step: str) -> Safety:
    clock = HostClock()
    session = RobotCalls(parse_address(note.robot), config.robot, clock, RobotClockEstimate(), clock.now_ns)
    pace = LockStep(lock_step, clock.now_ns()) if lock_step else None
    try:
        session.log_in(note.token)
        is_ours = _is_ours(session, note)
        if session.is_without_power():
            return Safety.HAD_NO_POWER
        if not _hold(session, note, is_ours=is_ours):
            return Safety.NOT_OURS
        with contextlib.suppress(ClockError):  # a robot that syncs no clocks may still sit down
            session.sync_clocks()

        def pause(duration_s: float) -> None:
            time.sleep(duration_s) if pace is None else pace.pause(duration_s)
            session.retain_lease()

        session.motions(pause).power_off()
        return Safety.POWERED_OFF
    finally:
        session.close()
        if pace is not None:
            pace.stop()


def _is_ours(session: RobotCalls, note: LeaseNote) -> bool:
    """Whether the newest lease that the robot knows of is the note's; then it is taken up, to be used or given back."""
    newest = session.newest_lease(note.resource)
    if newest is None or (newest.epoch, newest.sequence[0]) != (note.epoch, note.root):
        return False
    session.adopt_lease(newest)
    return True


def _hold(session: RobotCalls, note: LeaseNote, *, is_ours: bool) -> bool:
    """Have a lease to use: the note's, as it is, or a new one.

    Returns:
        Whether there is one; False where somebody else has one and has commanded the robot.

    Raises:
        LeaseHeldError: Somebody else has one, and has commanded nothing.
    """
    if is_ours:
        try:
            session.retain_lease()
        except LeaseHeldError:  # it went stale, or somebody took it just now
            session.has_lease = False
    if session.has_lease:
        return True
    try:
        session.acquire_lease()
    except LeaseHeldError as error:
        newest = session.newest_lease(note.resource)
        if newest is not None and any(newest.sequence[1:]):  # each use of a lease raises its last number
            return False
        who = next(iter(newest.client_names), "") if newest is not None else ""
        raise LeaseHeldError(f"{who or 'another client'} has its lease and commands nothing") from error
    return True
