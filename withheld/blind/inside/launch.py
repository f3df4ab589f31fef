"""Run the diagnosis, or another program, under an import ban and an allow-list of files.

    python -I launch.py WORDS.json

``WORDS.json``: ``path``, ``banned`` (packages), ``allowed`` (folders and files that may be opened), ``words``
(of ``spot-rl diagnose``), ``program`` (a script to run in its place; for the tests that try to cheat). The hook is
the interpreter's own (PEP 578) and cannot be taken off; what native code opens it does not see, namespaces do.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

DIE_WITH_PARENT = 1
REFUSED = "withheld check: refused"
STARTS = (
    "subprocess.Popen",
    "os.exec",
    "os.posix_spawn",
    "os.system",
    "os.spawn",
    "os.forkpty",
    "os.fork",
    "pty.spawn",
    "socket.connect",
    "socket.bind",
    "socket.sendto",
    "os.kill",
    "os.killpg",
)
PATHS = (
    "open",
    "os.listdir",
    "os.scandir",
    "os.rename",
    "os.remove",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chdir",
    "os.chmod",
    "shutil.copyfile",
    "shutil.copytree",
    "sqlite3.connect",
)


class Ban:
    """First on ``sys.meta_path``: these packages do not exist."""

    def __init__(self, banned: Sequence[str]) -> None:
        self._banned = frozenset(banned)

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Refuse, or leave it to the others."""
        if name.partition(".")[0] in self._banned:
            raise ImportError(f"{REFUSED} import of {name}")


def hook(banned: Sequence[str], allowed: Sequence[str]) -> Callable[[str, tuple[Any, ...]], None]:
    """The audit hook."""
    names = frozenset(banned)
    real = tuple(sorted({os.path.realpath(a) for a in allowed}))
    trees = tuple(a + os.sep for a in real)

    def is_allowed(path: str) -> bool:
        resolved = os.path.realpath(path)
        return resolved in real or resolved.startswith(trees)

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "import":
            if str(arguments[0]).partition(".")[0] in names:
                raise ImportError(f"{REFUSED} import of {arguments[0]}")
        elif event in PATHS:
            path = arguments[0]
            if event in ("os.listdir", "os.scandir") and path is None:
                path = "."
            if isinstance(path, bytes):
                path = os.fsdecode(path)
            if isinstance(path, (str, os.PathLike)) and not is_allowed(os.fspath(path)):
                raise PermissionError(f"{REFUSED} {event} of {path}")
        elif event in STARTS:
            raise PermissionError(f"{REFUSED} {event}")

    return watch


def main() -> None:
    """Do it."""
    ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    spec = json.loads(Path(sys.argv[1]).read_text())
    sys.path[:] = spec["path"]
    sys.meta_path.insert(0, Ban(spec["banned"]))
    sys.addaudithook(hook(spec["banned"], spec["allowed"]))
    if spec["program"]:
        import runpy

        runpy.run_path(spec["program"], run_name="__main__")
        return
    from diagnosis.command import diagnose

    diagnose(spec["words"])


if __name__ == "__main__":
    main()
