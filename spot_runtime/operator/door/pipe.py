"""Bytes from one socket to another within an event loop: never more than one part of them in memory."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from typing import Final, NamedTuple

PART_BYTES: Final = 65_536


class Flow(NamedTuple):
    """How much passes."""

    burst_bytes: int
    """At once."""
    bytes_per_s: int
    """After that."""


FULL: Final = Flow(1_000_000, 1_000_000)
OF_NEWCOMERS: Final = Flow(16_384, 65_536)
"""Enough for a handshake with certificates and the head of a call. Who has shown no role could otherwise send gRPC a
megabyte of pings on each of many connections."""


class Pipe:
    """One direction of a connection; its flow is bounded."""

    def __init__(
        self, source: socket.socket, target: socket.socket, on_end: Callable[[], None], flow: Flow = FULL
    ) -> None:
        """Begin to pass on; ``on_end`` is called when either socket has gone."""
        self._source, self._target, self._on_end, self._flow = source, target, on_end, flow
        self._loop = asyncio.get_running_loop()
        self._left = memoryview(b"")
        self._timer: asyncio.TimerHandle | None = None
        self._allowance_bytes, self._allowance_s = float(flow.burst_bytes), time.monotonic()
        self._is_over = False
        self._loop.add_reader(source, self._read)

    def widen(self, flow: Flow = FULL) -> None:
        """Let that much pass from now on."""
        self._flow, self._allowance_bytes = flow, float(flow.burst_bytes)

    def hold(self, duration_s: float) -> None:
        """Read nothing for a while."""
        if self._is_over or self._timer is not None:
            return
        self._loop.remove_reader(self._source)
        self._timer = self._loop.call_later(duration_s, self._go_on)

    def close(self) -> None:
        """Pass on nothing any more; the sockets are their owner's."""
        self._is_over = True
        if self._timer is not None:
            self._timer.cancel()
        self._loop.remove_reader(self._source)
        self._loop.remove_writer(self._target)

    def _go_on(self) -> None:
        self._timer = None
        if not self._left:
            self._loop.add_reader(self._source, self._read)

    def _read(self) -> None:
        try:
            data = self._source.recv(min(PART_BYTES, self._flow.burst_bytes))
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:
            self._on_end()
            return
        self._left = memoryview(data)
        self._write()
        self._pay(len(data))

    def _write(self) -> None:
        try:
            self._left = self._left[self._target.send(self._left) :]
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self._on_end()
            return
        if self._left:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._target, self._write)
            return
        self._loop.remove_writer(self._target)
        if self._timer is None:
            self._loop.add_reader(self._source, self._read)

    def _pay(self, size: int) -> None:
        now_s = time.monotonic()
        earned = (now_s - self._allowance_s) * self._flow.bytes_per_s
        self._allowance_bytes = min(float(self._flow.burst_bytes), self._allowance_bytes + earned) - size
        self._allowance_s = now_s
        if self._allowance_bytes < 0.0:
            self.hold(-self._allowance_bytes / self._flow.bytes_per_s)
