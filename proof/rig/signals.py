"""Signals of somebody who wants a bench to end, told from those that its faults raise: a run answers both alike."""

from __future__ import annotations

import contextlib
import os
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_raised: Counter[int] = Counter()


def raise_as_fault(number: signal.Signals) -> None:
    """Send this process a signal that belongs to what is tried."""
    _raised[number] += 1
    signal.raise_signal(number)


@contextmanager
def ending_the_bench() -> Iterator[None]:
    """After the block, end the bench if a signal came in it that no fault has raised; only in the main thread.

    The run in the block answers the signal first, and brings its robot to rest.

    Raises:
        KeyboardInterrupt: It was SIGINT.
        SystemExit: It was SIGTERM or SIGHUP; the exit code is 128 and its number.
    """
    _raised.clear()
    heard, told = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    before, came = signal.set_wakeup_fd(told, warn_on_full_buffer=False), b""
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        with contextlib.suppress(BlockingIOError):
            came = os.read(heard, 65536)
        os.close(heard)
        os.close(told)
    for number in ENDING:
        if came.count(number) > _raised[number]:
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)
