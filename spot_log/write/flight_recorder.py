"""What led to a stop, in a file of its own: the seconds before and after it, on disk before anything else can go wrong.

The log holds the same, but the log may be what failed. Here everything stays in this process's memory until the joints
are at rest; then it is written like any log, so that every tool for logs opens it.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Collection
from pathlib import Path
from typing import Final

from google.protobuf.message import DecodeError

from spot_log.format.events import EventName
from spot_log.format.records import TOPIC_OF_RECORD, EventRecord, Record, RunHeader
from spot_log.write.hand_off import message_of
from spot_log.write.run_writer import RunWriter
from spot_log.write.sink import ForwardingSink, LogSink
from spot_model.errors import SpotRlError

FOLDER: Final = "incidents"
"""Beside the logs, so that a run is not counted twice when logs are collected."""

KEPT: Final = {"state": 667, "command": 667, "tick": 100, "slow_state": 10, "event": 200}
"""Records kept of each topic, before the stop and after it: 2 s."""


def flight_record_path(log_path: Path) -> Path:
    """Where the incident of a run goes."""
    return log_path.parent / FOLDER / log_path.name


class FlightRecorder(ForwardingSink):
    """A log that passes everything on and remembers the newest of it."""

    def __init__(self, sink: LogSink, wanted_ends: Collection[str]) -> None:
        """Pass on to ``sink``; a stop for one of ``wanted_ends``, labels of reasons, is no incident."""
        super().__init__(sink)
        self._wanted_ends = wanted_ends
        self._rings: dict[str, deque[Record]] = {topic: deque(maxlen=count) for topic, count in KEPT.items()}
        self._before: list[Record] = []
        self._is_written = False
        self.cause = ""
        """The reason of the stop that began the incident; empty while there is none."""

    def put(self, record: Record) -> None:
        """Pass it on, and keep it; a stop ends the time before."""
        super().put(record)
        if isinstance(record, EventRecord) and record.name == EventName.STOP.label and not self.cause:
            reason = record.text.partition(":")[0]
            if reason not in self._wanted_ends:
                self.cause = reason
                self._before = [kept for ring in self._rings.values() for kept in list(ring)]
                # From now on the first records count, not the newest.
                self._rings = {topic: deque() for topic in KEPT}
        topic = TOPIC_OF_RECORD[type(record)]
        ring = self._rings[topic]
        if len(ring) < KEPT[topic] or not self.cause:
            ring.append(record)

    def write(self, log_path: Path, header: RunHeader, outcome: str) -> tuple[EventName, str] | None:
        """Write what led to the stop to disk, once; call it when the joints are at rest.

        Returns:
            The event to tell: where it is, or why it could not be written. None where there is nothing to write.
        """
        if not self.cause or self._is_written:
            return None
        self._is_written = True
        path = flight_record_path(log_path)
        try:
            self._write(path, header, outcome)
        except SpotRlError as error:
            return EventName.INCIDENT_FAILED, str(error)
        except OSError as error:
            return EventName.INCIDENT_FAILED, f"the incident file {path} cannot be written: {error.strerror or error}"
        return EventName.INCIDENT, f"the seconds around the stop are in {path}"

    def _write(self, path: Path, header: RunHeader, outcome: str) -> None:
        kept = [*self._before, *(entry for ring in self._rings.values() for entry in list(ring))]
        path.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
        writer = RunWriter(path, header, min_free_bytes=0)
        numbers = dict.fromkeys(KEPT, 0)
        for record in sorted(kept, key=lambda record: record.host_stamp_ns):
            topic = TOPIC_OF_RECORD[type(record)]
            numbers[topic] += _add(writer, numbers[topic], record)
        writer.close({}, outcome)
        _sync(path.parent)


def _add(writer: RunWriter, number: int, record: Record) -> int:
    """Add a record; 1, or 0 for one that is so broken that no log takes it."""
    try:
        message = message_of(record)
    except (TypeError, ValueError, OverflowError, DecodeError, SpotRlError):
        return 0
    writer.add(message, number)
    return 1


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
