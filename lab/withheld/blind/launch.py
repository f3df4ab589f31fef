"""Run ``spot-rl diagnose``, and write down each file that it opens: python -P launch.py OPENED WORDS...

The interpreter's own audit hook (PEP 578) sees what Python code opens and imports; what native code or another process
opens it does not see.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from typing import Any

DIE_WITH_PARENT = 1


def main() -> None:
    """Set the hook, and diagnose."""
    ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    opened, *words = sys.argv[1:]
    file = os.open(opened, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def write_down(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[0], (str, bytes, os.PathLike)):
            os.write(file, os.fsencode(os.path.realpath(arguments[0])) + b"\n")

    sys.addaudithook(write_down)
    from diagnosis.command import diagnose

    diagnose(words)


if __name__ == "__main__":
    main()
