"""What the checks ask of this computer; a test gives another one."""

from __future__ import annotations

import ctypes
import importlib.metadata
import os
import platform
import shutil
import sys
from pathlib import Path
from typing import Final

from spot_runtime.rescue.lease_note import note_folder

_MUNLOCK_OK: Final = 0


class Host:
    """This computer. Every question leaves it as it was."""

    def __init__(self, root: Path = Path("/")) -> None:
        """Read ``/sys`` and ``/proc`` under ``root``."""
        self._root = root

    def python_version(self) -> tuple[int, int, int]:
        """Major, minor, micro."""
        return sys.version_info[0], sys.version_info[1], sys.version_info[2]

    def machine(self) -> str:
        """The processor's architecture, as ``aarch64``."""
        return platform.machine()

    def text(self, path: str) -> str | None:
        """The content of a file under the root, stripped; None where it cannot be read."""
        try:
            return (self._root / path).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            return None

    def texts(self, pattern: str) -> dict[str, str]:
        """Content of every file that matches, by its path under the root."""
        found = {str(path.relative_to(self._root)): "" for path in sorted(self._root.glob(pattern))}
        return {path: text for path in found if (text := self.text(path)) is not None}

    def requirements(self, package: str) -> list[str]:
        """Requirement lines of an installed package; empty where it is not installed."""
        try:
            return importlib.metadata.requires(package) or []
        except importlib.metadata.PackageNotFoundError:
            return []

    def installed_version(self, package: str) -> str | None:
        """An installed package's version."""
        try:
            return importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            return None

    def fifo_refusal(self, priority: int) -> str:
        """Why SCHED_FIFO is refused; empty where it is granted. Asked for and given back at once."""
        policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as error:
            return error.strerror or str(error)
        os.sched_setscheduler(0, policy, parameter)
        return ""

    def memory_lock_refusal(self) -> str:
        """Why locking all memory is refused; empty where it is granted. Locked and given back at once."""
        libc = ctypes.CDLL(None, use_errno=True)
        current_future_onfault = 1 | 2 | 4
        if libc.mlockall(current_future_onfault) != _MUNLOCK_OK:
            return os.strerror(ctypes.get_errno())
        libc.munlockall()
        return ""

    def note_folder(self) -> Path:
        """Where a control process leaves its note of a lease."""
        return note_folder(os.environ)

    def usable_cpus(self) -> set[int]:
        """CPUs that this process may use."""
        return os.sched_getaffinity(0)

    def free_bytes(self, folder: Path) -> int | None:
        """Room on the disk of a folder that is there and writable; None where it is not."""
        if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
            return None
        return shutil.disk_usage(folder).free
