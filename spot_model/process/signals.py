"""Who answers a signal: a handler while a block runs, or the program that this one runs in front of the user."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Final, NamedTuple, NoReturn

from spot_model.process.child_process import ChildProcess

STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


@contextmanager
def answered(answer: Callable[[int], object], *numbers: signal.Signals) -> Iterator[None]:
    """Have ``answer`` called with the number of each of these signals while the block runs; only in the main thread."""

    def handle(number: int, frame: FrameType | None) -> None:
        del frame
        answer(number)

    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def exit_on_termination() -> Iterator[None]:
    """Let the stop signals end the block as Ctrl-C does, so that it clears away its folders and its processes.

    Also those that the process was started to ignore, as ``nohup`` and a script's ``&`` have it. Only in the main
    thread.

    Raises:
        KeyboardInterrupt: Ctrl-C, or its signal.
        SystemExit: Another one came; the exit code is 128 and its number.
    """

    def end(number: int) -> NoReturn:
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + number)

    with answered(end, *STOP_SIGNALS):
        yield


class Ended(NamedTuple):
    """How a program ended."""

    code: int
    """Its exit code; 128 + n where signal n ended it."""
    is_interrupted: bool
    """Whether somebody asked for the end while it ran."""


def run_in_foreground(
    command: Sequence[str], environment: Mapping[str, str] | None = None, *, kill_after_s: float = math.inf
) -> Ended:
    """Start a program and wait until it has ended, however long it takes: a run first brings its robot to rest.

    A terminal sends Ctrl-C to both processes, so it is not passed on; SIGTERM is. Only the main thread may call this.

    Args:
        command: Its words.
        environment: Its own; this process's if None.
        kill_after_s: It is killed so long after a SIGTERM that did not end it.

    Raises:
        OSError: The program cannot be started.
    """
    started: list[ChildProcess] = []
    asked: list[int] = []

    def pass_on(number: int) -> None:
        asked.append(number)
        if number == signal.SIGTERM:
            for process in started:
                end(process)

    def end(process: ChildProcess) -> None:
        process.send(signal.SIGTERM)
        if kill_after_s < math.inf:
            killer = threading.Timer(kill_after_s, process.kill)
            killer.daemon = True
            killer.start()

    with answered(pass_on, signal.SIGINT, signal.SIGTERM):
        started.append(ChildProcess.start(command, environment=environment, reads_terminal=True))
        if signal.SIGTERM in asked:
            end(started[0])
        code = started[0].wait() or 0
    return Ended(code if code >= 0 else 128 - code, bool(asked))
