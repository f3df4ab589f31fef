"""Where words about a run go: the terminal, by a thread of its own, and the system's journal in its datagram format.

``journalctl -u spot-rl SPOT_RL_EVENT=stop`` then finds every stop, with its figures as fields. Lines that are no events
go to standard error as ever, which the journal also takes. A stalled terminal must not stall the loop.

Source: the format is documented at systemd.io/JOURNAL_NATIVE_PROTOCOL.
"""

from __future__ import annotations

import os
import queue
import socket
import struct
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, TextIO

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


IDENTIFIER: Final = "spot-rl"
PRIORITY: Final = {Severity.INFO: 6, Severity.WARNING: 4, Severity.ERROR: 3}
"""syslog's levels: info, warning, err."""


def goes_to_journal(stream: TextIO, environment: Mapping[str, str]) -> bool:
    """Whether a stream is connected to the journal: its device and inode are those that the environment names."""
    wanted = environment.get("JOURNAL_STREAM", "")
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return bool(wanted) and wanted == f"{status.st_dev}:{status.st_ino}"


class Journal:
    """Sends events to the journal; never blocks. What it does not take is left to the caller."""

    def __init__(self, path: Path = Path("/run/systemd/journal/socket")) -> None:
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)

    @staticmethod
    def if_heard() -> Journal | None:
        """The system's journal, if this process's standard error goes there."""
        return Journal() if goes_to_journal(sys.stderr, os.environ) else None

    def event(self, record: EventRecord) -> bool:
        """Write an event. Returns whether the journal took it."""
        fields = {
            "MESSAGE": f"{record.name}: {record.text}",
            "PRIORITY": str(PRIORITY[record.severity]),
            "SYSLOG_IDENTIFIER": IDENTIFIER,
            "SPOT_RL_EVENT": record.name,
            "SPOT_RL_HOST_STAMP_NS": str(record.host_stamp_ns),
            "SPOT_RL_ROBOT_STAMP_NS": str(record.robot_stamp_ns),
            **{f"SPOT_RL_{name.upper()}": f"{value:.9g}" for name, value in record.values.items()},
        }
        try:
            self._socket.sendto(entry_of(fields), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL, self._path)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()


def tell_by(journal: Journal | None, console: Console) -> Callable[[EventRecord], None]:
    """What tells of events: the journal, and the console for what that does not take."""

    def tell(record: EventRecord) -> None:
        if journal is None or not journal.event(record):
            console.event(record)

    return tell


def entry_of(fields: Mapping[str, str]) -> bytes:
    """One entry: ``NAME=value`` lines; a value of several lines as name, length (64 bit, little endian) and bytes."""
    parts = []
    for name, value in fields.items():
        data = value.encode()
        if b"\n" in data:
            parts.append(name.encode() + b"\n" + struct.pack("<Q", len(data)) + data + b"\n")
        else:
            parts.append(name.encode() + b"=" + data + b"\n")
    return b"".join(parts)
