"""Connections that have sent their first byte, let through to gRPC one after the other: each peer in turn."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Final

from spot_runtime.operator.door.connection import Connection

RATE_HZ: Final = 400.0
"""A new connection costs gRPC about a millisecond."""

BURST: Final = 32.0


class Queue:
    """At most :data:`RATE_HZ` a second; who has gone meanwhile is dropped, and costs nothing."""

    def __init__(self, let_through: Callable[[Connection], None]) -> None:
        """Call ``let_through`` with each connection when its turn comes; use it within one event loop."""
        self._let_through = let_through
        self._waiting: OrderedDict[str, deque[Connection]] = OrderedDict()
        self._tokens, self._since_s = BURST, time.monotonic()
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def add(self, connection: Connection) -> None:
        """Let it wait for its turn, which may be now."""
        self._waiting.setdefault(connection.group, deque()).append(connection)
        if self._timer is None:
            self._turn()

    def close(self) -> None:
        """Grant no more turns."""
        if self._timer is not None:
            self._timer.cancel()
        self._waiting.clear()

    def _turn(self) -> None:
        now_s = time.monotonic()
        self._tokens = min(BURST, self._tokens + (now_s - self._since_s) * RATE_HZ)
        self._since_s, self._timer = now_s, None
        while self._waiting and self._tokens >= 1.0:
            connection = self._next()
            if connection.has_hung_up:
                connection.close()
                continue
            self._tokens -= 1.0
            self._let_through(connection)
        if self._waiting:
            self._timer = self._loop.call_later((1.0 - self._tokens) / RATE_HZ, self._turn)

    def _next(self) -> Connection:
        group, crowd = self._waiting.popitem(last=False)
        connection = crowd.popleft()
        if crowd:
            self._waiting[group] = crowd  # behind all others
        return connection
