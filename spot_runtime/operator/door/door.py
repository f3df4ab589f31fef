"""Where connections come in. There is always room for one more: the client that takes most of it gives way.

gRPC itself would keep every connection that anybody opens, so a few thousand idle ones would keep an operator out who
wants to stop the robot. Here a newcomer is always taken. Connections on which nobody with a role has called yet are
cheap and many; the oldest of the peer that has most of them is closed for a newcomer. Those of somebody with a role are
few; one that offends goes first, then one that is idle, then the one that was used longest ago.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from spot_runtime.operator.door.acceptor import Acceptor
from spot_runtime.operator.door.connection import Connection
from spot_runtime.operator.door.queue import Queue

MAX_NEWCOMERS: Final = 128
"""At 400 a second none of them waits longer than 0.3 s for its turn."""

MAX_ADMITTED: Final = 64
MAX_OF_ONE: Final = 32
"""Admitted connections of one process, one user of loopback, or one certificate."""

DENIED_HOLD_S: Final = 1.0
"""Time for which nothing is read from a connection after a call without a role, s."""

ROLE_TIMEOUT_S: Final = 5.0
"""Time after which a connection without a call by a client with a role is closed, s."""

SWEEP_PERIOD_S: Final = 1.0
Crowds = dict[str, dict[str, Connection]]
"""Connections by whose they are, then by name, the oldest first."""


class Door:
    """Accepts connections and passes them on to gRPC's own socket. All of it runs in one event loop."""

    def __init__(self, listeners: Sequence[socket.socket], inner_path: Path) -> None:
        """Accept on ``listeners`` for the gRPC server at ``inner_path``; call it from the event loop."""
        self._queue = Queue(lambda connection: connection.open(inner_path))
        self._connections: dict[str, Connection] = {}
        self._newcomers: Crowds = {}
        self._admitted: Crowds = {}
        self._loop = asyncio.get_running_loop()
        self._acceptors = [Acceptor(listener, self._wake) for listener in listeners]
        self._sweeper = self._loop.call_later(SWEEP_PERIOD_S, self._sweep)

    def find(self, grpc_peer: str) -> Connection | None:
        """The connection that gRPC calls by this name."""
        return self._connections.get(grpc_peer.rpartition(":")[2])

    def admit(self, connection: Connection, identity: str) -> None:
        """Somebody with a role calls on it: it counts as theirs from now on."""
        connection.used_s = time.monotonic()
        if connection.is_admitted:
            return
        _remove(self._newcomers, connection)
        connection.admit()
        if connection.peer.user_id is None:  # of another computer, where one process is as good as another
            connection.group = identity
        self._admitted.setdefault(connection.group, {})[connection.name] = connection
        crowd = self._admitted[connection.group]
        if len(crowd) <= MAX_OF_ONE:
            if _count(self._admitted) <= MAX_ADMITTED:
                return
            crowd = max(self._admitted.values(), key=len)
        others = [other for other in crowd.values() if other is not connection]
        if others:
            min(others, key=lambda other: (other.standing, other.used_s)).close()

    def deny(self, connection: Connection) -> None:
        """Somebody without a role called. A connection that waits costs less than the new one after a cut."""
        connection.hold(DENIED_HOLD_S)

    def slow_down(self, connection: Connection, hold_s: float = 0.05) -> None:
        """Calls come too often on it: it waits for ``hold_s`` and each connection that there is."""
        connection.offended_s = time.monotonic()
        connection.hold(hold_s * min(_count(self._admitted), 16))

    def close(self) -> None:
        """Accept no more connections, and cut all."""
        self._sweeper.cancel()
        for acceptor in self._acceptors:
            acceptor.close()
        self._queue.close()
        for connection in list(self._connections.values()):
            connection.close()

    def _wake(self) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._take)

    def _take(self) -> None:
        for acceptor in self._acceptors:
            for accepted in acceptor.take():
                self._begin(accepted)

    def _begin(self, accepted: socket.socket) -> None:
        with contextlib.suppress(OSError):  # TCP alone has it
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = Connection(accepted, on_first_byte=self._queue.add, on_end=self._ended)
        self._connections[connection.name] = connection
        self._newcomers.setdefault(connection.group, {})[connection.name] = connection
        if _count(self._newcomers) > MAX_NEWCOMERS:
            self._close_oldest_newcomer()

    def _close_oldest_newcomer(self) -> None:
        if self._newcomers:
            crowd = max(self._newcomers.values(), key=len)
            next(iter(crowd.values())).close()

    def _ended(self, connection: Connection) -> None:
        self._connections.pop(connection.name, None)
        _remove(self._admitted if connection.is_admitted else self._newcomers, connection)

    def _sweep(self) -> None:
        """Close what has shown no role in time."""
        now_s = time.monotonic()
        for crowd in list(self._newcomers.values()):
            for connection in list(crowd.values()):
                if now_s - connection.born_s > ROLE_TIMEOUT_S:
                    connection.close()
        self._sweeper = self._loop.call_later(SWEEP_PERIOD_S, self._sweep)


def _count(crowds: Mapping[str, Mapping[str, Connection]]) -> int:
    return sum(map(len, crowds.values()))


def _remove(crowds: Crowds, connection: Connection) -> None:
    crowd = crowds.get(connection.group, {})
    crowd.pop(connection.name, None)
    if not crowd:
        crowds.pop(connection.group, None)
