"""Lines for the person at the terminal, written by a thread of its own: a stalled terminal must not stall the loop."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable
from typing import TextIO

from spot_log.format.records import EventRecord, Severity
from spot_model.text import plain_lines


class Console:
    """Prints lines as they come and a progress line each second."""

    def __init__(self, stream: TextIO | None = None, *, period_s: float = 1.0) -> None:
        """Write to ``stream``; to standard error unless told otherwise."""
        self._stream = sys.stderr if stream is None else stream
        self._period_s = period_s
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._progress: Callable[[], str] | None = None
        self._thread = threading.Thread(target=self._run, name="console", daemon=True)
        self._thread.start()

    def say(self, line: str) -> None:
        """Print a line, soon."""
        self._lines.put(line)

    def event(self, record: EventRecord) -> None:
        """Print an event, soon."""
        mark = "" if record.severity is Severity.INFO else f"{record.severity.name.lower()}: "
        self.say(f"{mark}{record.name}: {record.text.removeprefix(f'{record.name}: ')}")

    def show(self, progress: Callable[[], str] | None) -> None:
        """Print what this says each second; None ends it."""
        self._progress = progress

    def close(self) -> None:
        """Print what is left, for at most two seconds."""
        self._progress = None
        self._lines.put(None)
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        while True:
            try:
                line = self._lines.get(timeout=self._period_s)
            except queue.Empty:
                progress = self._progress
                line = progress() if progress is not None else ""
            if line is None:
                return
            if line:
                self._write(line)

    def _write(self, line: str) -> None:
        try:
            self._stream.write(f"{plain_lines(line)}\n")
            self._stream.flush()
        except (OSError, ValueError):
            return  # the reader has gone; the run goes on
