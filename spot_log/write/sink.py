"""Sinks of the log: the protocol, and those that discard, pass on, or keep everything in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

from spot_log.format.records import CommandRecord, EventRecord, TickRecord
from spot_model.robot.state import RobotState, SlowState

TOPICS: Final = ("state", "command", "tick", "slow_state", "event")
"""Topics that the loop writes; header and footer are the log's own."""


@dataclass(frozen=True)
class SinkHealth:
    """How the log is doing; read it a few times a second, off the loop's hot path."""

    is_alive: bool
    dropped: Mapping[str, int]
    """Lost between the loop and the log, by topic."""
    unwritten: Mapping[str, int]
    """Reached the log's process but not the disk (disk full, undecodable), by topic."""
    problem: str = ""
    """Empty while all is well; otherwise one sentence that names the cause."""


class LogSink(Protocol):
    """The log as the control loop sees it. No call blocks or raises, whatever happens to the log.

    Each topic is written by one thread at a time; different topics may be written by different threads.
    """

    def state(self, wire: bytes, host_stamp_ns: int) -> None:
        """Log one state as the wire bytes of a vendor RobotStateStreamResponse, and when it was received."""

    def decoded_state(self, state: RobotState) -> None:
        """Log one state of an adapter that has no wire bytes (replay)."""

    def command(self, record: CommandRecord) -> None:
        """Log one command that was sent."""

    def tick(self, record: TickRecord) -> None:
        """Log one policy tick."""

    def slow_state(self, state: SlowState) -> None:
        """Log one poll of battery, temperatures and faults."""

    def event(self, record: EventRecord) -> None:
        """Log one event."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """Messages lost between the loop and the log so far, by topic; every topic is present."""

    def health(self) -> SinkHealth:
        """Tell whether the log still works. Does not block."""

    def close(self, outcome: str) -> None:
        """End the log: ``completed``, or the reason of the stop. Waits a bounded time; a second call does nothing."""


class NullSink:
    """A log that keeps nothing."""

    def state(self, wire: bytes, host_stamp_ns: int) -> None:
        """Forget it."""

    def decoded_state(self, state: RobotState) -> None:
        """Forget it."""

    def command(self, record: CommandRecord) -> None:
        """Forget it."""

    def tick(self, record: TickRecord) -> None:
        """Forget it."""

    def slow_state(self, state: SlowState) -> None:
        """Forget it."""

    def event(self, record: EventRecord) -> None:
        """Forget it."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """Nothing counts as lost where nothing is kept."""
        return dict.fromkeys(TOPICS, 0)

    def health(self) -> SinkHealth:
        """Always well."""
        return SinkHealth(is_alive=True, dropped=self.dropped, unwritten=dict.fromkeys(TOPICS, 0))

    def close(self, outcome: str) -> None:
        """Nothing to end."""


class ForwardingSink:
    """A log that passes everything on to another one."""

    def __init__(self, to: LogSink) -> None:
        self._to = to

    def state(self, wire: bytes, host_stamp_ns: int) -> None:
        """Pass it on."""
        self._to.state(wire, host_stamp_ns)

    def decoded_state(self, state: RobotState) -> None:
        """Pass it on."""
        self._to.decoded_state(state)

    def command(self, record: CommandRecord) -> None:
        """Pass it on."""
        self._to.command(record)

    def tick(self, record: TickRecord) -> None:
        """Pass it on."""
        self._to.tick(record)

    def slow_state(self, state: SlowState) -> None:
        """Pass it on."""
        self._to.slow_state(state)

    def event(self, record: EventRecord) -> None:
        """Pass it on."""
        self._to.event(record)

    @property
    def dropped(self) -> Mapping[str, int]:
        """As of the log behind."""
        return self._to.dropped

    def health(self) -> SinkHealth:
        """As of the log behind."""
        return self._to.health()

    def close(self, outcome: str) -> None:
        """Close the log behind."""
        self._to.close(outcome)


@dataclass
class MemorySink:
    """A log in memory, for tests: everything in the order of its topic."""

    states: list[tuple[bytes, int]] = field(default_factory=list)
    decoded_states: list[RobotState] = field(default_factory=list)
    commands: list[CommandRecord] = field(default_factory=list)
    ticks: list[TickRecord] = field(default_factory=list)
    slow_states: list[SlowState] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    outcome: str | None = None

    def state(self, wire: bytes, host_stamp_ns: int) -> None:
        """Keep the bytes and the stamp."""
        self.states.append((wire, host_stamp_ns))

    def decoded_state(self, state: RobotState) -> None:
        """Keep the state."""
        self.decoded_states.append(state)

    def command(self, record: CommandRecord) -> None:
        """Keep the record."""
        self.commands.append(record)

    def tick(self, record: TickRecord) -> None:
        """Keep the record."""
        self.ticks.append(record)

    def slow_state(self, state: SlowState) -> None:
        """Keep the state."""
        self.slow_states.append(state)

    def event(self, record: EventRecord) -> None:
        """Keep the record."""
        self.events.append(record)

    @property
    def dropped(self) -> Mapping[str, int]:
        """Nothing is ever lost."""
        return dict.fromkeys(TOPICS, 0)

    def health(self) -> SinkHealth:
        """Always well, until closed."""
        return SinkHealth(is_alive=self.outcome is None, dropped=self.dropped, unwritten=dict.fromkeys(TOPICS, 0))

    def close(self, outcome: str) -> None:
        """Keep the first outcome."""
        if self.outcome is None:
            self.outcome = outcome
