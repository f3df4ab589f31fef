"""What a process has from the one that started it, set right at its entry: streams, signals, warnings.

``nohup``, a shell's ``&``, a supervisor or a parent with threads hand down settings by which a program is deaf to its
stop signals, or fails at its first word to the user.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Mapping
from typing import Final

from spot_model.process.signals import STOP_SIGNALS

SAFE_PATH: Final = "PYTHONSAFEPATH"
"""Keeps the Python programs that libraries start, as MuJoCo's does, from finding modules in the current folder."""


def set_right() -> None:
    """Give this process standard streams that take any text, and unblock its signals. Call it once, at its entry.

    Raises:
        SystemExit: The system keeps a signal blocked.
    """
    _open_streams()
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    if blocked:
        raise SystemExit(f"error: the system keeps signals blocked that must stop this process: {sorted(blocked)}")
    os.environ.setdefault(SAFE_PATH, "1")
    # With PYTHONWARNINGS=error a library's word about its next version would end a run.
    if any(kept[0] == "error" for kept in warnings.filters):
        warnings.simplefilter("default")


def answer_signals() -> None:
    """Let signals act that the parent had this process ignore, as ``nohup`` and a script's ``&`` do."""
    for number in STOP_SIGNALS:
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)


def environment_as_inherited(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a program of the user's, which may lie beside its own modules."""
    is_theirs = getattr(sys.flags, "safe_path", False)
    return {name: value for name, value in environment.items() if name != SAFE_PATH or is_theirs}


def _open_streams() -> None:
    """A stream that is closed (``2>&-``) leaves its number to the next file, which would then get what is printed."""
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= 2:
        os.set_inheritable(descriptor, True)
        descriptor = os.open(os.devnull, os.O_RDWR)
    os.close(descriptor)
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115 - they live as long as the process
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
