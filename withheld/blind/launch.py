"""Run the diagnosis, or another program, under an audit hook that bans imports, foreign files, processes and sockets.

    python -I launch.py WORDS.json

``WORDS.json``: ``path``, ``banned`` (packages), ``allowed`` (folders and files that may be opened), ``hidden``
(folders within these that may not), ``words`` (of ``spot-rl diagnose``), ``program`` (a script to run in its place).
The hook is the interpreter's own (PEP 578) and cannot be taken off; what native code opens it does not see, namespaces
do.
"""

from __future__ import annotations

import ctypes
import json
import os
import runpy
import signal
import sys
from pathlib import Path
from typing import Any

DIE_WITH_PARENT = 1
REFUSED = "withheld check: refused"
STARTS = {
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
}
PATHS = {
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
}


class Watch:
    """The audit hook."""

    def __init__(self, banned: list[str], allowed: list[str], hidden: list[str]) -> None:
        self._banned = frozenset(banned)
        self._allowed, self._hidden = ([os.path.realpath(path) for path in paths] for paths in (allowed, hidden))

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Refuse an event by an error, or let it pass."""
        if event == "import":
            if str(arguments[0]).partition(".")[0] in self._banned:
                raise ImportError(f"{REFUSED} import of {arguments[0]}")
        elif event in PATHS:
            path = "." if arguments[0] is None else arguments[0]
            if isinstance(path, (str, bytes, os.PathLike)) and not self._may_open(os.fsdecode(path)):
                raise PermissionError(f"{REFUSED} {event} of {os.fsdecode(path)}")
        elif event in STARTS:
            raise PermissionError(f"{REFUSED} {event}")

    def _may_open(self, path: str) -> bool:
        real = os.path.realpath(path)
        return _is_within(real, self._allowed) and not _is_within(real, self._hidden)


def _is_within(path: str, places: list[str]) -> bool:
    return any(path == place or path.startswith(place + os.sep) for place in places)


def main() -> None:
    """Set the hook, and run what the file says."""
    ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    spec = json.loads(Path(sys.argv[1]).read_text())
    sys.path[:] = spec["path"]
    sys.addaudithook(Watch(spec["banned"], spec["allowed"], spec["hidden"]))
    if spec["program"]:
        runpy.run_path(spec["program"], run_name="__main__")
        return
    from diagnosis.command import diagnose

    diagnose(spec["words"])


if __name__ == "__main__":
    main()
