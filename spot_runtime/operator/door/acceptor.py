"""Accepts connections in a thread of its own, so that a storm of them does not keep the event loop from its calls."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from typing import Final

from spot_runtime.operator.door.connection import has_hung_up

BACKLOG: Final = 4096
MAX_HANDED_OVER: Final = 64
"""Connections that the event loop has not taken yet."""

NO_ROOM_PAUSE_S: Final = 0.01


class Acceptor:
    """Hands over each connection whose client is still there."""

    def __init__(self, listener: socket.socket, hand_over: Callable[[socket.socket, Callable[[], None]], None]) -> None:
        """Accept on ``listener`` from now on.

        Args:
            listener: A bound socket.
            hand_over: Called in another thread, with a connection and with what to call once it was taken.
        """
        self._listener, self._hand_over = listener, hand_over
        self._room = threading.Semaphore(MAX_HANDED_OVER)
        self._is_over = False
        listener.settimeout(0.5)
        listener.listen(BACKLOG)
        self._thread = threading.Thread(target=self._run, name="accept", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Accept nothing any more."""
        self._is_over = True
        self._room.release()
        self._thread.join(2.0)
        self._listener.close()

    def _run(self) -> None:
        while not self._is_over:
            try:
                accepted, _ = self._listener.accept()
            except (TimeoutError, ConnectionAbortedError, InterruptedError):
                continue
            except OSError:  # no descriptors are left, until the event loop closes some
                time.sleep(NO_ROOM_PAUSE_S)
                continue
            if has_hung_up(accepted):  # most have in a storm of them, and must cost next to nothing
                accepted.close()
                continue
            self._room.acquire()
            self._hand_over(accepted, self._room.release)
