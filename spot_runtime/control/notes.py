"""Events that one step writes, gathered while it runs."""

from __future__ import annotations

from collections.abc import Mapping

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord


class Notes:
    """Lives as long as one step."""

    def __init__(self, told: frozenset[tuple[EventName, str]], host_ns: int, robot_ns: int) -> None:
        """Stamp events with these instants; ``told`` holds the once-only events that have been reported."""
        self.told, self._host_ns, self._robot_ns = told, host_ns, robot_ns
        self.events: list[EventRecord] = []

    def event(self, name: EventName, text: str, values: Mapping[str, float] | None = None) -> None:
        """Write an event."""
        record = EventRecord(self._host_ns, self._robot_ns, name.severity, name.label, text, dict(values or {}))
        self.events.append(record)

    def once(self, name: EventName, text: str, values: Mapping[str, float] | None = None, *, about: str = "") -> None:
        """Write an event whose repetitions, of the same name and about the same, would only flood the log."""
        if (name, about) not in self.told:
            self.told |= {(name, about)}
            self.event(name, text, values)
