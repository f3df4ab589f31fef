"""Bytes from gRPC back to a client, as soon as it takes them."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable
from typing import Final

PART_BYTES: Final = 16_384
WOULD_BLOCK: Final = (BlockingIOError, InterruptedError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


class Outflow:
    """One direction of a connection: never more than one part of it in memory."""

    def __init__(self, source: socket.socket, target: socket.socket, on_end: Callable[[], None]) -> None:
        """Begin to pass on; ``on_end`` is called when either socket has gone."""
        self._source, self._target, self._on_end = source, target, on_end
        self._loop = asyncio.get_running_loop()
        self._left = memoryview(b"")
        self._loop.add_reader(source, self._read)

    def close(self) -> None:
        """Pass on nothing any more; the sockets are their owner's."""
        self._loop.remove_reader(self._source)
        self._loop.remove_writer(self._target)

    def _read(self) -> None:
        try:
            data = self._source.recv(PART_BYTES)
        except WOULD_BLOCK:
            return
        except OSError:
            data = b""
        if not data:
            self._on_end()
            return
        self._left = memoryview(data)
        self._write()

    def _write(self) -> None:
        try:
            self._left = self._left[self._target.send(self._left) :]
        except WOULD_BLOCK:
            pass
        except OSError:
            self._on_end()
            return
        if self._left:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._target, self._write)
        else:
            self._loop.remove_writer(self._target)
            self._loop.add_reader(self._source, self._read)
