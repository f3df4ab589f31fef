"""The loop's side of the log: hands records to the log's process, never waits, and counts what it cannot hand over."""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from spot_log.errors import LogError
from spot_log.format import codec
from spot_log.format.records import TOPIC_OF_RECORD, Record, RunHeader
from spot_log.write import hand_off
from spot_log.write.run_writer import active_path, check_can_start
from spot_log.write.sink import TOPICS, SinkHealth
from spot_model.process.child_process import ChildProcess
from spot_protos import log_pb2

SEND_BUFFER_BYTES: Final = 4 << 20
START_TIMEOUT_S: Final = 60.0
CLOSE_TIMEOUT_S: Final = 10.0
_FLAGS: Final = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL


class LoggerProcess:
    """A :class:`~spot_log.write.sink.LogSink` that writes to a file from another process."""

    def __init__(self, child: ChildProcess, connection: socket.socket, path: Path) -> None:
        self._child = child
        self._socket = connection
        self.path = path
        self._sequence, self._dropped = dict.fromkeys(TOPICS, 0), dict.fromkeys(TOPICS, 0)
        self._is_alive = True
        self._is_closed = False
        self._child_problem = ""
        self._own_problem = ""
        self._unwritten: dict[str, int] = dict.fromkeys(TOPICS, 0)
        self._place: str | None = None

    @staticmethod
    def start(path: Path, header: RunHeader, *, timeout_s: float = START_TIMEOUT_S) -> LoggerProcess:
        """Start the process and wait until the file is open; until it is closed it is called ``path`` + ``.active``.

        Raises:
            LogError: The log exists, the disk is too full or not writable, or the process does not start.
        """
        path = path.absolute()
        _check_directory(path)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            # The kernel grants what its wmem_max allows; the child drains into memory, so little is enough.
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            child = ChildProcess.start(
                "spot_log.write.logger_child",
                str(theirs.fileno()),
                str(path),
                told=codec.header_to_proto(header).SerializeToString(),
                descriptors=(theirs.fileno(),),
            )
        sink = LoggerProcess(child, ours, path)
        try:
            sink._wait_ready(timeout_s)
        except (OSError, LogError) as error:
            child.kill()
            child.end()
            ours.close()
            raise error if isinstance(error, LogError) else LogError(f"the log's process: {error}") from error
        return sink

    @property
    def process_id(self) -> int:
        """The number of the log's process."""
        return self._child.pid

    def put(self, record: Record) -> None:
        """Hand a record to the log's process, or count it as dropped."""
        topic = TOPIC_OF_RECORD[type(record)]
        sequence = self._sequence[topic]
        self._sequence[topic] = sequence + 1
        if not self._is_alive:
            self._dropped[topic] += 1
            return
        try:
            self._socket.send(hand_off.pack(sequence, record), _FLAGS)
        except (BlockingIOError, InterruptedError):
            self._dropped[topic] += 1
        except (ConnectionError, TimeoutError):
            self._is_alive = False
            self._dropped[topic] += 1
        except (OSError, TypeError, ValueError, AttributeError, OverflowError, struct.error) as error:
            self._dropped[topic] += 1
            self._own_problem = f"a {topic} record could not be handed to the log: {error}"

    @property
    def dropped(self) -> Mapping[str, int]:
        """Messages that did not reach the log's process, by topic."""
        return dict(self._dropped)

    def health(self) -> SinkHealth:
        """Read the process's reports, without waiting."""
        self._read_status()
        if self._is_alive and self._child.exit_code is not None:
            self._is_alive = False
        problem = self._child_problem or self._own_problem
        if not self._is_alive and not self._is_closed:
            problem = (
                f"the log's process ended ({self._child.end_in_words}); {active_path(self.path)} holds what it had"
            )
        elif not problem and any(self._dropped.values()):
            problem = f"the log's process does not keep up: {sum(self._dropped.values())} messages dropped"
        return SinkHealth(self._is_alive, self.dropped, dict(self._unwritten), problem, self._place)

    def close(self, outcome: str) -> None:
        """End the log; waits until the file is whole, at most :data:`CLOSE_TIMEOUT_S`."""
        if self._is_closed:
            return
        deadline_s = time.monotonic() + CLOSE_TIMEOUT_S
        footer = log_pb2.Footer(dropped=self.dropped, outcome=outcome)
        if self._is_alive:
            select.select([], [self._socket], [], CLOSE_TIMEOUT_S)
            try:
                self._socket.send(hand_off.pack_close(footer), _FLAGS)
                self._socket.shutdown(socket.SHUT_WR)
            except OSError as error:
                self._own_problem = f"the log could not be told to close: {error}"
        if self._child.wait(max(0.1, deadline_s - time.monotonic())) is None:
            self._own_problem = f"the log's process has not finished after {CLOSE_TIMEOUT_S:g} s; it goes on by itself"
        self.health()
        if self._place is None:  # it ended by itself, or still writes
            there = (path for path in (self.path, active_path(self.path)) if path.exists())
            self._place = str(next(there, ""))
        self._is_closed, self._is_alive = True, False
        self._socket.close()

    def _wait_ready(self, timeout_s: float) -> None:
        readable, _, _ = select.select([self._socket], [], [], timeout_s)
        data = self._socket.recv(hand_off.MAX_DATAGRAM_BYTES) if readable else b""
        if not data:
            raise LogError(f"the log's process did not start within {timeout_s:g} s ({self._child.end_in_words})")
        status = json.loads(data)
        if not status["ready"]:
            raise LogError(status["refused"])

    def _read_status(self) -> None:
        while not self._is_closed:
            try:
                data = self._socket.recv(hand_off.MAX_DATAGRAM_BYTES, socket.MSG_DONTWAIT)
            except OSError:
                return
            if not data:
                return
            status = json.loads(data)
            self._child_problem = status["problem"]
            self._unwritten = {**dict.fromkeys(TOPICS, 0), **status["unwritten"]}
            self._place = status["path"] if status["closed"] else None


def _check_directory(path: Path) -> None:
    try:
        check_can_start(path)
    except FileNotFoundError as error:
        raise LogError(f"there is no directory {path.parent} to log to; make it first") from error
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"cannot log to {path.parent}: {error}") from error
