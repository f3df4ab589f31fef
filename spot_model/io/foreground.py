"""A program that this one runs in front of the user, until it has ended: Ctrl-C is the program's to answer."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Mapping, Sequence
from types import FrameType
from typing import NamedTuple


class Ended(NamedTuple):
    """How a program ended."""

    code: int
    """Its exit code; 128 + n where signal n ended it."""
    is_interrupted: bool
    """Whether somebody asked for the end while it ran."""


def run_in_foreground(command: Sequence[str], environment: Mapping[str, str] | None = None) -> Ended:
    """Start a program and wait until it has ended, however long it takes: a run first brings its robot to rest.

    A terminal sends Ctrl-C to both processes, so it is not passed on; SIGTERM is. Only the main thread may call this.

    Raises:
        OSError: The program cannot be started.
    """
    started: list[subprocess.Popen[bytes]] = []
    asked: list[int] = []

    def pass_on(number: int, frame: FrameType | None) -> None:
        del frame
        asked.append(number)
        if number == signal.SIGTERM:
            for process in started:
                process.send_signal(number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        started.append(subprocess.Popen(command, env=None if environment is None else dict(environment)))  # noqa: S603
        if signal.SIGTERM in asked:
            started[0].send_signal(signal.SIGTERM)
        code = started[0].wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return Ended(code if code >= 0 else 128 - code, bool(asked))
