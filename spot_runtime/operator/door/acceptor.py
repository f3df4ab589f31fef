"""Accepts connections in a thread of its own, so that a storm of them does not keep the event loop from its calls."""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from spot_runtime.operator.door.connection import has_hung_up

BACKLOG: Final = 4096
MAX_WAITING: Final = 64
"""Connections that the event loop has not taken yet. It needs 0.2 ms for each; to accept one, and to close the oldest
of whoever has most in its place, takes a tenth of that, so that a storm passes and its newest are taken."""

NO_ROOM_PAUSE_S: Final = 0.01


class Acceptor:
    """Keeps the newest connections whose clients are still there, until they are taken."""

    def __init__(self, listener: socket.socket, wake: Callable[[], None]) -> None:
        """Accept on a bound socket from now on.

        ``wake`` is called in another thread when there is something to take, once until it is taken.
        """
        self._listener, self._wake = listener, wake
        self._waiting: dict[str, deque[socket.socket]] = {}
        self._lock = threading.Lock()
        self._is_over = False
        listener.settimeout(0.5)
        listener.listen(BACKLOG)
        self._thread = threading.Thread(target=self._run, name="accept", daemon=True)
        self._thread.start()

    def take(self) -> list[socket.socket]:
        """What was accepted since the last call, each address in turn, its oldest first."""
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        taken = []
        while waiting:
            taken += [crowd.popleft() for crowd in waiting.values()]
            waiting = {address: crowd for address, crowd in waiting.items() if crowd}
        return taken

    def close(self) -> None:
        """Accept nothing any more."""
        self._is_over = True
        self._thread.join(2.0)
        self._listener.close()
        for accepted in self.take():
            accepted.close()

    def _run(self) -> None:
        while not self._is_over:
            try:
                accepted, address = self._listener.accept()
            except (TimeoutError, ConnectionAbortedError, InterruptedError):
                continue
            except OSError:  # no descriptors are left, until the event loop closes some
                time.sleep(NO_ROOM_PAUSE_S)
                continue
            if has_hung_up(accepted):  # most have in a storm of them, and must cost next to nothing
                accepted.close()
                continue
            self._keep(accepted, str(address[0]) if address else "")

    def _keep(self, accepted: socket.socket, address: str) -> None:
        given_up = None
        with self._lock:
            is_first = not self._waiting
            self._waiting.setdefault(address, deque()).append(accepted)
            if sum(map(len, self._waiting.values())) > MAX_WAITING:
                given_up = max(self._waiting.values(), key=len).popleft()
        if given_up is not None:
            given_up.close()
        if is_first:
            self._wake()
