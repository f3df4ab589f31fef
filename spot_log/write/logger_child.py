"""The log's process: receives what the loop hands over, decodes it, and writes the file.

One thread only receives, so that a stalled disk does not fill the socket; the main thread decodes and writes. The
process ends when the socket closes, and by nothing else that its parent also gets: it outlives the loop's shutdown.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import socket
import struct
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Final

from google.protobuf.message import DecodeError

from spot_log.write.hand_off import MAX_DATAGRAM_BYTES, TOPIC_OF_KIND, Kind, unpack, unpack_head
from spot_log.write.live_tap import LiveTap
from spot_log.write.run_writer import RunWriter
from spot_log.write.sink import TOPICS
from spot_model.errors import SpotRlError
from spot_protos import log_pb2

FLUSH_PERIOD_S: Final = 0.5
MAX_QUEUED: Final = 60_000
"""Datagrams held while the disk stalls: 90 s of a full stream, about 60 MB."""
SHARED_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
"""Those that ask the loop to stop; a terminal's keys and a service manager send them to every process of a run."""

PARENT_LOST: Final = "interrupted: the process that drove the robot ended without closing its log"


class LoggerChild:
    """Everything that the process keeps."""

    def __init__(self, connection: socket.socket, path: Path, header: log_pb2.Header) -> None:
        self._connection = connection
        self._tap = LiveTap.from_environment()
        self._writer = RunWriter(path, header, copy_to=self._tap.put)
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._unwritten: Counter[str] = Counter()
        self._overflowed: Counter[str] = Counter()
        self._expected_sequence: Counter[str] = Counter()
        self._missing: Counter[str] = Counter()
        self._problem = ""
        self._footer: log_pb2.Footer | None = None

    def run(self) -> None:
        """Receive and write until the socket closes."""
        self._tell(is_ready=True)
        receiver = threading.Thread(target=self._receive, name="receive", daemon=True)
        receiver.start()
        next_flush_s = time.monotonic() + FLUSH_PERIOD_S
        is_open = True
        while is_open:
            try:
                datagram = self._queue.get(timeout=max(0.0, next_flush_s - time.monotonic()))
            except queue.Empty:
                pass
            else:
                is_open = datagram is not None
                if datagram is not None:
                    self._take(datagram)
            if time.monotonic() >= next_flush_s or self._writer.is_chunk_full:
                self._flush()
                next_flush_s = time.monotonic() + FLUSH_PERIOD_S
        self._close()

    def _receive(self) -> None:
        buffer = bytearray(MAX_DATAGRAM_BYTES)
        view = memoryview(buffer)
        while True:
            try:
                size = self._connection.recv_into(buffer, 0, socket.MSG_DONTWAIT)
            except BlockingIOError:
                # Waiting inside recv would make every send of the loop wake this process, which costs the loop 10 µs.
                time.sleep(0.004)
                continue
            except OSError:
                size = 0
            if not size:
                self._queue.put(None)
                return
            datagram = bytes(view[:size])
            if self._queue.qsize() < MAX_QUEUED or datagram[0] == Kind.CLOSE:
                self._queue.put(datagram)
            else:
                self._overflowed[_topic_of(datagram)] += 1

    def _take(self, datagram: bytes) -> None:
        topic = _topic_of(datagram)
        try:
            kind, sequence = unpack_head(datagram)
            if kind is not Kind.CLOSE:
                self._missing[topic] += sequence - self._expected_sequence[topic]
                self._expected_sequence[topic] = sequence + 1
            record = unpack(datagram).message
        except (ValueError, struct.error, DecodeError, SpotRlError) as error:
            self._lose(Counter({topic: 1}), f"a record could not be decoded: {error}")
            return
        if isinstance(record, log_pb2.Footer):
            self._footer = record
        else:
            self._writer.add(record, sequence)

    def _flush(self) -> None:
        buffered = self._writer.buffered
        try:
            self._writer.flush()
        except OSError as error:
            self._lose(Counter(buffered), f"the log cannot be written: {error.strerror or error}")
        self._tell()

    def _lose(self, counts: Counter[str], problem: str) -> None:
        self._unwritten.update(counts)
        self._problem = problem

    def _close(self) -> None:
        dropped, outcome = dict.fromkeys(TOPICS, 0), PARENT_LOST
        if self._footer is not None:
            dropped.update(self._footer.dropped)
            outcome = self._footer.outcome
        else:
            dropped.update(self._missing)
        buffered = self._writer.buffered
        for topic, count in self._unwritten.items():
            dropped[topic] = dropped.get(topic, 0) + count
        try:
            self._writer.close(dropped, outcome)
        except OSError as error:
            self._writer.abandon()
            self._lose(Counter(buffered), f"the log could not be closed: {error.strerror or error}")
            if self._writer.place is None:
                self._unwritten.update(self._writer.written)
        self._tell(is_closed=True)

    def _move(self) -> str:
        """That the log is not where it was begun; empty where it is, or is nowhere."""
        place = self._writer.place
        if place is None or place.parent == self._writer.path.parent:
            return ""
        return f"the log's folder was moved while it was being written; the log is in {place.parent}"

    def _tell(self, *, is_ready: bool = False, is_closed: bool = False) -> None:
        status = {
            "ready": is_ready,
            "closed": is_closed,
            "unwritten": dict(self._unwritten + self._overflowed),
            "problem": self._problem or self._move(),
            "path": str(self._writer.place or ""),
        }
        send_status(self._connection, status)


def send_status(connection: socket.socket, status: dict[str, object]) -> None:
    """Tell the loop's process how it goes; a full socket or a dead parent costs a report, nothing else."""
    with contextlib.suppress(OSError):
        connection.send(json.dumps(status).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)


def _topic_of(datagram: bytes) -> str:
    try:
        return TOPIC_OF_KIND[unpack_head(datagram)[0]]
    except (ValueError, KeyError):
        return "unknown"


def shed_inherited_settings() -> None:
    """Give up what a real-time parent hands down: FIFO scheduling, CPU affinity, and to be ended by its signals."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    for number in SHARED_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def main() -> None:
    """Run the process: arguments are the socket's descriptor and the log's path, the header comes on stdin."""
    shed_inherited_settings()
    connection = socket.socket(fileno=int(sys.argv[1]))
    try:
        child = LoggerChild(connection, Path(sys.argv[2]), log_pb2.Header.FromString(sys.stdin.buffer.read()))
    except (OSError, SpotRlError) as error:
        refused = str(error)
        if not isinstance(error, SpotRlError):
            refused = f"log {sys.argv[2]} cannot be begun: {error.strerror}; make room, or log to another disk"
        send_status(connection, {"ready": False, "refused": refused, "kind": type(error).__name__})
        raise SystemExit(1) from None
    child.run()


if __name__ == "__main__":
    main()
