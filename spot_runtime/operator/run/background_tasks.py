"""What takes long while the robot stands: opening a log, loading a policy. Done beside the cycles, not between them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


class BackgroundTask:
    """One task at a time, in a thread of its own; its result is taken up by the thread that runs the cycles."""

    def __init__(self, *, is_sync: bool) -> None:
        """With ``is_sync`` each task is done at once: in lock-step the robot waits anyway."""
        self._is_sync = is_sync
        self._thread: threading.Thread | None = None
        self._result: tuple[Any, Exception | None] | None = None
        self._then: Callable[[Any, Exception | None], None] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether one is under way."""
        return self._then is not None

    def run(self, task: Callable[[], Any], then: Callable[[Any, Exception | None], None]) -> None:
        """Begin a task; ``then`` gets its result or its error, called by :meth:`finish`.

        Raises:
            RuntimeError: One is under way.
        """
        if self.is_busy:
            raise RuntimeError("a task is under way")
        self._then, self._result = then, None
        if self._is_sync:
            self._work(task)
            self.finish()
            return
        self._thread = threading.Thread(target=self._work, args=(task,), name="background", daemon=True)
        self._thread.start()

    def finish(self) -> None:
        """Take up the result, if it is there."""
        if self._result is None or self._then is None:
            return
        (value, error), then = self._result, self._then
        self._result = self._then = self._thread = None
        then(value, error)

    def wait(self) -> None:
        """Wait for the end of one that is under way, and take up its result."""
        if self._thread is not None:
            self._thread.join()
        self.finish()

    def _work(self, task: Callable[[], Any]) -> None:
        try:
            self._result = (task(), None)
        except Exception as error:  # noqa: BLE001 - it is passed on to the caller
            self._result = (None, error)
