"""Where connections come in. There is always room for one more: the client that takes most of it gives way.

    accepted ──► handshake: who calls ──► frames ──► gRPC, on a socket of its own
                 └──────────── in turns ────────┘

Everything that a client makes the service do waits for its turn here, so that none waits behind another's flood.
Connections without a call by somebody with a role are many; the oldest of the peer that has most of them is closed for
a newcomer. Those of somebody with a role are few; of whoever has most, the one that was used longest ago is closed.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from spot_runtime.operator.door.connection import Connection, Way, has_hung_up
from spot_runtime.operator.door.turns import Place, Turns

MAX_NEWCOMERS: Final = 256
MAX_ADMITTED: Final = 64
MAX_OF_ONE: Final = 32
"""Admitted connections of one process, one user of loopback, or one certificate."""

DENIED_REST_S: Final = 1.0
"""Time for which nothing is taken from a connection after a call without a role, s."""

ROLE_TIMEOUT_S: Final = 5.0
"""Time after which a connection without a call by a client with a role is closed, s."""

SWEEP_PERIOD_S: Final = 1.0
Crowds = dict[str, dict[str, Connection]]
"""Connections by whose they are, then by name, the oldest first."""


class Door:
    """Accepts connections and passes them on to gRPC's own socket. All of it runs in one event loop."""

    def __init__(self, listener: socket.socket, inner_path: Path, tls: ssl.SSLContext | None) -> None:
        """Accept on ``listener`` for the gRPC server at ``inner_path``; call it from the event loop."""
        self._listener, self._turns = listener, Turns()
        self._way = Way(self._turns, inner_path, tls, self._met, self._ended, self._crowd)
        self._connections: dict[str, Connection] = {}
        self._newcomers: Crowds = {}
        self._admitted: Crowds = {}
        self._loop = asyncio.get_running_loop()
        listener.setblocking(False)
        listener.listen(4096)
        self._loop.add_reader(listener, self._accept)
        self._sweeper = self._loop.call_later(SWEEP_PERIOD_S, self._sweep)

    def find(self, grpc_peer: str) -> Connection | None:
        """The connection that gRPC calls by this name."""
        return self._connections.get(grpc_peer.rpartition(":")[2])

    def admit(self, connection: Connection, group: str = "") -> None:
        """Somebody with a role is at its other end: it counts as theirs from now on; of its group if none is given."""
        connection.used_s = time.monotonic()
        if connection.is_admitted:
            return
        self._move(connection, group or connection.group, is_admitted=True)
        crowd = self._admitted[connection.group]
        if len(crowd) <= MAX_OF_ONE:
            if _count(self._admitted) <= MAX_ADMITTED:
                return
            crowd = max(self._admitted.values(), key=len)
        others = [other for other in crowd.values() if other is not connection]
        if others:
            min(others, key=lambda other: (other.stops_open, other.used_s)).close()

    def close(self) -> None:
        """Accept no more connections, and cut all."""
        self._sweeper.cancel()
        self._loop.remove_reader(self._listener)
        self._listener.close()
        self._turns.close()
        for connection in list(self._connections.values()):
            connection.close()

    def _accept(self) -> None:
        for _ in range(64):
            try:
                accepted, _ = self._listener.accept()
            except (BlockingIOError, InterruptedError):
                return
            except ConnectionAbortedError:
                continue
            except OSError:  # no descriptors are left
                self._close_oldest_newcomer()
                return
            if has_hung_up(accepted):
                accepted.close()
                continue
            self._begin(accepted)

    def _begin(self, accepted: socket.socket) -> None:
        with contextlib.suppress(OSError):  # TCP alone has it
            accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            connection = Connection(accepted, self._way)
        except (OSError, ValueError):  # it has gone meanwhile
            accepted.close()
            return
        self._connections[connection.name] = connection
        self._newcomers.setdefault(connection.group, {})[connection.name] = connection
        if _count(self._newcomers) > MAX_NEWCOMERS:
            self._close_oldest_newcomer()

    def _met(self, connection: Connection) -> None:
        """Those with half a handshake do not make room for those with none; a certificate with a role is somebody's."""
        if connection.caller is None:
            self._move(connection, f"{connection.group}, greeted", is_admitted=False)
        elif self._way.tls is not None and connection.caller.role is not None:
            self.admit(connection, connection.caller.identity)

    def _move(self, connection: Connection, group: str, *, is_admitted: bool) -> None:
        has_waited = self._turns.withdraw(connection.turn)
        self._remove(connection)
        connection.group, connection.is_admitted = group, is_admitted
        self._crowds(connection).setdefault(group, {})[connection.name] = connection
        if has_waited:
            self._turns.ask(connection.turn, Place(is_admitted, group))

    def _remove(self, connection: Connection) -> None:
        crowds = self._crowds(connection)
        crowd = crowds.get(connection.group, {})
        crowd.pop(connection.name, None)
        if not crowd:
            crowds.pop(connection.group, None)

    def _crowds(self, connection: Connection) -> Crowds:
        return self._admitted if connection.is_admitted else self._newcomers

    def _crowd(self, connection: Connection) -> int:
        return len(self._crowds(connection).get(connection.group, ()))

    def _close_oldest_newcomer(self) -> None:
        if self._newcomers:
            crowd = max(self._newcomers.values(), key=len)
            next(iter(crowd.values())).close()

    def _ended(self, connection: Connection) -> None:
        self._connections.pop(connection.name, None)
        self._remove(connection)

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
