"""A mailbox for one value: a newer one replaces an older one that nobody has taken yet."""

from __future__ import annotations

import queue
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestSlot(Generic[T]):
    """Hands the newest value of one thread to another one that waits; ``put`` never blocks.

    A queue of the C library carries at most one token, which says that there is something to take: a condition variable
    takes several times as long.
    """

    def __init__(self) -> None:
        """Start empty and open."""
        self._value: deque[T] = deque(maxlen=1)
        self._tokens: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._is_closed = False
        self.replaced = 0
        """Values that nobody took."""

    def put(self, value: T) -> None:
        """Leave a value; after ``close`` it is dropped."""
        if self._value:
            self.replaced += 1
        self._value.append(value)
        # A reader that took the last token just now has not looked for the value yet, or will get another token.
        if self._tokens.empty():
            self._tokens.put(None)

    def take(self) -> T | None:
        """Wait for a value; None once the slot is closed."""
        while True:
            self._tokens.get()
            if self._is_closed:
                self._tokens.put(None)  # for whoever asks again
                return None
            if self._value:
                return self._value.popleft()

    def close(self) -> None:
        """Wake the waiting thread for good; what nobody took is dropped."""
        self._is_closed = True
        self._tokens.put(None)
