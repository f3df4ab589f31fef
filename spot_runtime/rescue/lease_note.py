"""The note of the process that holds a robot's lease: on disk from before power-on until the robot is at rest.

A note without a holder means that its writer died before it brought the robot to rest; it also names the
lease by which the robot can tell whether anybody has had it since. The note is locked while its writer lives.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from spot_model.errors import SpotRlError
from spot_model.process.private_folder import new_private_file
from spot_runtime.causes import shortage
from spot_runtime.host.instance_lock import open_locked

MAX_BYTES: Final = 65_536
WITHIN_S: Final = 20.0
"""Longest silence of a robot that a note names until it is given up. With a last try of some 30 s, less than the unit
gives everything that comes after a stop."""


class LeaseNoteError(SpotRlError):
    """The note cannot be written or read."""

    exit_code = 78


class NoteHeldError(LeaseNoteError):
    """The process that wrote the note lives."""


@dataclass(frozen=True)
class LeaseNote:
    """Which lease was held of which robot, and by which login. Its file can be read by its owner alone."""

    robot: str
    resource: str
    epoch: str
    root: int
    """First number of the lease's sequence; every holder has another."""
    token: str = field(repr=False)
    """Token of the login, in place of user name and password, which systemd hides from what it runs after a stop."""


def note_folder(environment: Mapping[str, str]) -> Path:
    """Where notes lie: the unit's state folder, else the user's."""
    unit = environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if unit:
        return Path(unit)
    base = environment.get("XDG_STATE_HOME", "")
    return (Path(base) if base.startswith("/") else Path.home() / ".local" / "state") / "spot-rl"


def note_path(robot: str, folder: Path) -> Path:
    """The note of one robot, by its address."""
    return folder / f"lease-{hashlib.sha256(robot.encode()).hexdigest()[:16]}.json"


def is_held(path: Path) -> bool:
    """Whether somebody lives who wrote this note, or acts on it."""
    try:
        found = HeldNote.find(path)
    except NoteHeldError:
        return True
    except LeaseNoteError:
        return False
    if found is not None:
        found[0].let_go()
    return False


class HeldNote:
    """A note that this process holds: others see that its holder lives, until it is released."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path, self._descriptor = path, descriptor

    @staticmethod
    def write(path: Path, note: LeaseNote, instead_of: HeldNote | None = None) -> HeldNote:
        """Write a note to the disk, as a new file that takes the place of an old one, whoever may read that.

        ``instead_of`` is the one that this process holds there; it is let go in any case.

        Raises:
            LeaseNoteError: It cannot be written, or the process lives that wrote the old one.
        """
        old = instead_of or HeldNote._old(path)
        fresh, descriptor = None, -1
        try:
            fresh, descriptor = new_private_file(path)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.pwrite(descriptor, json.dumps(asdict(note)).encode(), 0)
            os.fsync(descriptor)
            fresh.replace(path)
        except OSError as error:
            HeldNote(fresh or path, descriptor).let_go()
            if fresh is not None:
                fresh.unlink(missing_ok=True)  # half a note would look like a robot that was left with power
            raise LeaseNoteError(
                f"the note {path} of the lease, by which a crash is made good, cannot be written: {error.strerror}; "
                "make room, or see to the folder"
            ) from error
        finally:
            if old is not None:
                old.let_go()
        return HeldNote(path, descriptor)

    @staticmethod
    def find(path: Path) -> tuple[HeldNote, LeaseNote] | None:
        """A note whose writer is gone, and its content; None if there is none.

        Raises:
            NoteHeldError: Its writer lives.
            LeaseNoteError: It cannot be read.
        """
        if not path.exists():
            return None
        try:
            held = HeldNote._open(path)
        except FileNotFoundError:  # its holder has just removed it
            return None
        try:
            content = json.loads(os.pread(held._descriptor, MAX_BYTES, 0))
            texts = {name: str(content[name]) for name in ("robot", "resource", "epoch", "token")}
            note = LeaseNote(**texts, root=int(content["root"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            held.let_go()
            raise LeaseNoteError(f"the note {path} of a lease is damaged: see to the robot, then delete it") from error
        return held, note

    def remove(self) -> None:
        """The robot is at rest, or no longer ours. Where it cannot be removed, the next process asks the robot."""
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)
        self.let_go()

    def let_go(self) -> None:
        """Leave it on disk for the next process; a second call does nothing."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    @staticmethod
    def _old(path: Path) -> HeldNote | None:
        """What is to be replaced; its lock keeps others from acting on it meanwhile."""
        try:
            return HeldNote._open(path)
        except FileNotFoundError:
            return None

    @staticmethod
    def _open(path: Path) -> HeldNote:
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            return HeldNote(path, open_locked(path, 0))
        except BlockingIOError:
            raise NoteHeldError("the process that holds the robot's lease lives; stop that one instead") from None
        except OSError as error:
            if isinstance(error, FileNotFoundError):
                raise
            advice = shortage(str(error)) or "see to the folder"
            raise LeaseNoteError(
                f"the note {path}, by which a crash is made good, cannot be opened: {error.strerror}; {advice}"
            ) from error
