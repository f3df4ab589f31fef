"""Locked files that say that their writer is alive, and the one that keeps a second runtime away from a robot.

The lease refuses it robot-wide; this lock says so sooner, and also while the first one is between leases.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import tempfile
from pathlib import Path

from typing_extensions import Self

from spot_model.errors import SpotRlError


def open_locked(path: Path, flags: int = os.O_CREAT) -> int:
    """Open a file, made where ``flags`` say so, for its owner alone, and lock it. Returns the descriptor.

    A holder may remove the file before it releases the lock; a process that had opened it by then opens it again.

    Raises:
        BlockingIOError: Somebody holds it.
        OSError: It cannot be opened.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC | flags, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BaseException:
            os.close(descriptor)
            raise
        if _is_still_there(path, descriptor):
            return descriptor
        os.close(descriptor)


def _is_still_there(path: Path, descriptor: int) -> bool:
    try:
        there = path.lstat()
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))


class AlreadyRunningError(SpotRlError):
    """Another runtime drives this robot."""

    exit_code = 94


class LockError(SpotRlError):
    """The lock against a second runtime cannot be had."""

    exit_code = 99


class InstanceLock:
    """Held while it is entered; the system frees it when the process ends, however that happens."""

    def __init__(self, robot: str, directory: Path | None = None) -> None:
        """Lock by the robot's address, in the user's run-time directory unless told otherwise."""
        folder = directory or Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir())
        digest = hashlib.sha256(robot.encode()).hexdigest()[:16]
        self._robot = robot
        self._path = folder / f"spot-rl-{os.getuid()}-{digest}.lock"
        self._descriptor: int | None = None

    def __enter__(self) -> Self:
        """Take the lock.

        Raises:
            AlreadyRunningError: Another process holds it; the message names its number.
            LockError: It cannot be opened: no such folder, or something of somebody else's is in its place.
        """
        try:
            descriptor = open_locked(self._path)
        except BlockingIOError:
            raise AlreadyRunningError(
                f"process {self._holder()} already drives {self._robot} from this computer; end it, then start again"
            ) from None
        except OSError as error:
            raise LockError(
                f"the lock {self._path}, which keeps a second runtime away, cannot be opened: {error.strerror}; "
                "set XDG_RUNTIME_DIR to a folder of your own, or remove what is in the way"
            ) from error
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        self._descriptor = descriptor
        return self

    def __exit__(self, *_: object) -> None:
        if self._descriptor is not None:
            with contextlib.suppress(OSError):  # a disk that takes nothing any more; the lock ends all the same
                self._path.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = None

    def _holder(self) -> str:
        try:
            return self._path.read_bytes()[:20].decode("ascii", errors="replace").strip() or "unknown"
        except OSError:
            return "unknown"
