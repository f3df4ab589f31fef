"""The service's last events, for everybody who asks, and for those who wait for the next."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Final

from spot_protos import operator_pb2

KEPT: Final = 500


class EventBook:
    """A ring of numbered events. A reader that is too slow sees a gap in the numbers; it holds up nobody."""

    def __init__(self) -> None:
        """Begin empty."""
        self._events: deque[operator_pb2.Event] = deque(maxlen=KEPT)
        self._changed = threading.Condition()
        self.count = 0

    def add(self, event: operator_pb2.Event) -> None:
        """Number an event and keep it."""
        with self._changed:
            self.count += 1
            event.number = self.count
            self._events.append(event)
            self._changed.notify_all()

    def after(self, number: int, timeout_s: float) -> Sequence[operator_pb2.Event]:
        """Events with a higher number than this; waits for one at most ``timeout_s``."""
        with self._changed:
            if self.count <= number:
                self._changed.wait(timeout_s)
            return [event for event in self._events if event.number > number]
