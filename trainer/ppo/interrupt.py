"""Ctrl-C in a training: the iteration under way is finished and saved."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from spot_model.errors import SpotRlError


class TrainingInterruptedError(SpotRlError):
    """The user stopped a training; its last iteration is saved."""

    exit_code = 130


class StopRequest:
    """Whether the user has asked a training to stop."""

    def __init__(self) -> None:
        self.is_made = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take the first SIGINT or SIGTERM as a request; a second one acts as usual, at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

        def give_back() -> None:
            for number, handler in before.items():
                signal.signal(number, handler)

        def ask(*_: Any) -> None:
            self.is_made = True
            give_back()

        for number in before:
            signal.signal(number, ask)
        try:
            yield
        finally:
            give_back()
