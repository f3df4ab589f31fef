"""One connection to the service, passed on to gRPC's own socket."""

from __future__ import annotations

import asyncio
import os
import select
import socket
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Final

from spot_runtime.operator.door.peers import Peer, peer_of
from spot_runtime.operator.door.pipe import OF_NEWCOMERS, Pipe

OFFENCE_LASTS_S: Final = 10.0

_numbers = count(1)


class Connection:
    """An accepted connection. It is passed on to gRPC at its first byte, under :attr:`name`."""

    def __init__(
        self,
        outer: socket.socket,
        *,
        on_first_byte: Callable[[Connection], None],
        on_end: Callable[[Connection], None],
    ) -> None:
        """Take over an accepted socket; call it from the event loop.

        Args:
            outer: The accepted socket.
            on_first_byte: Called once; :meth:`open` should follow.
            on_end: Called once, when either end has gone.
        """
        self.peer: Peer = peer_of(outer)
        self.group = self.peer.group
        """Whose share of all connections it takes."""
        self.name = f"spot-rl-{os.getpid()}-{next(_numbers)}"
        self.is_admitted = False
        """Whether a call of somebody who has a role came through it; :meth:`admit` says so."""
        self.calls_open = 0
        self.stops_open = 0
        """Calls under way that stop the robot."""
        self.offended_s = -OFFENCE_LASTS_S
        """When a call on it last came too often, or without its message in time."""
        self.used_s = self.born_s = time.monotonic()
        self._outer, self._on_first_byte, self._on_end = outer, on_first_byte, on_end
        self._inner: socket.socket | None = None
        self._pipes: tuple[Pipe, ...] = ()
        self._is_over = False
        self._loop = asyncio.get_running_loop()
        outer.setblocking(False)
        self._loop.add_reader(outer, self._begin)

    @property
    def standing(self) -> int:
        """How much it deserves to stay: 0 for one that offends, 1 for an idle one, 2 for one in use, 3 for a stop."""
        if self.stops_open:
            return 3
        if time.monotonic() - self.offended_s <= OFFENCE_LASTS_S:
            return 0
        return 2 if self.calls_open else 1

    def admit(self) -> None:
        """Somebody who has a role calls on it."""
        self.is_admitted = True
        if self._pipes:
            self._pipes[0].widen()

    def hold(self, duration_s: float) -> None:
        """Take nothing from it for a while."""
        if self._pipes:
            self._pipes[0].hold(duration_s)

    def close(self) -> None:
        """Cut it; a second call does nothing."""
        if self._is_over:
            return
        self._is_over = True
        self._loop.remove_reader(self._outer)
        for pipe in self._pipes:
            pipe.close()
        self._outer.close()
        if self._inner is not None:
            self._inner.close()
        self._on_end(self)

    @property
    def has_hung_up(self) -> bool:
        """Whether the client has gone, though what it sent was not read yet."""
        return self._is_over or has_hung_up(self._outer)

    def open(self, inner_path: Path) -> None:
        """Connect to gRPC, which listens there, under a name that tells the two ends apart."""
        inner = self._inner = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        inner.setblocking(False)
        try:
            inner.bind(f"\0{self.name}")
            inner.connect(str(inner_path))
        except OSError:
            self.close()
            return
        self._pipes = (Pipe(self._outer, inner, self.close, OF_NEWCOMERS), Pipe(inner, self._outer, self.close))

    def _begin(self) -> None:
        self._loop.remove_reader(self._outer)
        self._on_first_byte(self)


def has_hung_up(end: socket.socket) -> bool:
    """Whether the other end has gone, though what it sent was not read yet."""
    poll = select.poll()
    poll.register(end, select.POLLRDHUP)
    return bool(poll.poll(0))
