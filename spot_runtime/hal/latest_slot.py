"""A mailbox for one value: a newer one replaces an older one that nobody has taken yet."""

from __future__ import annotations

import threading
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestSlot(Generic[T]):
    """Hands the newest value to one waiting thread; ``put`` never blocks for longer than a copy of a reference."""

    def __init__(self) -> None:
        """Start empty and open."""
        self._condition = threading.Condition(threading.Lock())
        self._value: T | None = None
        self._is_closed = False
        self.replaced = 0
        """Values that nobody took."""

    def put(self, value: T) -> None:
        """Leave a value; after ``close`` it is dropped."""
        with self._condition:
            if self._value is not None:
                self.replaced += 1
            self._value = value
            self._condition.notify()

    def take(self) -> T | None:
        """Wait for a value; None once the slot is closed."""
        with self._condition:
            while self._value is None and not self._is_closed:
                self._condition.wait()
            value, self._value = self._value, None
            return None if self._is_closed else value

    def close(self) -> None:
        """Wake the waiting thread for good; what nobody took is dropped."""
        with self._condition:
            self._is_closed = True
            self._condition.notify_all()
