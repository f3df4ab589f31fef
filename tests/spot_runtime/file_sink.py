"""A log that is written in the process of the loop: no other process starts, and what is written is the same."""

from __future__ import annotations

import threading
from pathlib import Path

from spot_log.format.records import TOPIC_OF_RECORD, Record, RunHeader
from spot_log.write import hand_off
from spot_log.write.run_writer import RunWriter
from spot_log.write.sink import NullSink


class FileSink(NullSink):
    """A sink that writes at once, through the same packing as the real one."""

    def __init__(self, writer: RunWriter, flush_every: int = 1000) -> None:
        self.writer = writer
        self._flush_every = flush_every
        self._n = 0
        self._numbers: dict[str, int] = {}
        self._lock = threading.Lock()
        self._is_closed = False

    @staticmethod
    def start(path: Path, header: RunHeader) -> FileSink:
        """Open a log without the copies for viewers."""
        return FileSink(RunWriter(path, header, for_viewers=False))

    def put(self, record: Record) -> None:
        """Write a record."""
        topic = TOPIC_OF_RECORD[type(record)]
        with self._lock:
            number = self._numbers.get(topic, 0)
            self._numbers[topic] = number + 1
            self.writer.add(hand_off.unpack(hand_off.pack(number, record)).message, number)
            self._n += 1
            if self._n % self._flush_every == 0:
                self.writer.flush()

    def close(self, outcome: str) -> None:
        """Close the file; a second call does nothing."""
        if not self._is_closed:
            self._is_closed = True
            self.writer.close(self.dropped, outcome)
