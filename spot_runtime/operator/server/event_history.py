"""The service's last events, for everybody who asks."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Final

from spot_log.format.records import EventRecord
from spot_protos import operator_pb2

KEPT: Final = 500


class EventHistory:
    """A ring of numbered events. A slow reader sees a gap in the numbers and delays nobody."""

    def __init__(self) -> None:
        self._events: deque[operator_pb2.Event] = deque(maxlen=KEPT)
        self._lock = threading.Lock()
        self.count = 0

    def add(self, record: EventRecord) -> None:
        """Number an event and keep it."""
        event = operator_pb2.Event(
            host_stamp_ns=record.host_stamp_ns,
            robot_stamp_ns=record.robot_stamp_ns,
            severity=record.severity.name.lower(),
            name=record.name,
            text=record.text,
            values=record.values,
        )
        with self._lock:
            self.count += 1
            event.number = self.count
            self._events.append(event)

    def after(self, number: int) -> Sequence[operator_pb2.Event]:
        """Events with a higher number than this."""
        if self.count <= number:
            return ()
        with self._lock:
            return [event for event in self._events if event.number > number]
