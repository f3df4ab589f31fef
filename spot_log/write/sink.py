"""Sinks of the log: the protocol, and those that discard, pass on, or keep everything in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol

from spot_log.format.records import TOPIC_OF_RECORD, CommandRecord, EventRecord, Record, TickRecord, WireState
from spot_model.robot.state import RobotState, SlowState

TOPICS: Final = tuple(dict.fromkeys(TOPIC_OF_RECORD.values()))
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
    path: str | None = None
    """Where a file is that was closed; empty where no name leads to it; None before, and of what is no file."""


class LogSink(Protocol):
    """The log as the control loop sees it. No call blocks or raises, whatever happens to the log.

    Each topic is written by one thread at a time; different topics may be written by different threads.
    """

    def put(self, record: Record) -> None:
        """Log a state, a command that was sent, a policy tick, a poll of the slow state, or an event."""

    @property
    def dropped(self) -> Mapping[str, int]:
        """Messages lost between the loop and the log so far, by topic; every topic is present."""

    def health(self) -> SinkHealth:
        """Tell whether the log still works. Does not block."""

    def close(self, outcome: str) -> None:
        """End the log: ``completed``, or the reason of the stop. Waits a bounded time; a second call does nothing."""


class NullSink:
    """A log that keeps nothing."""

    def put(self, record: Record) -> None:
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

    def put(self, record: Record) -> None:
        """Pass it on."""
        self._to.put(record)

    @property
    def dropped(self) -> Mapping[str, int]:
        """What the log behind has dropped."""
        return self._to.dropped

    def health(self) -> SinkHealth:
        """Health of the log behind."""
        return self._to.health()

    def close(self, outcome: str) -> None:
        """Close the log behind."""
        self._to.close(outcome)


@dataclass
class MemorySink(NullSink):
    """A log in memory, for tests: everything in the order of its topic."""

    states: list[WireState] = field(default_factory=list)
    decoded_states: list[RobotState] = field(default_factory=list)
    commands: list[CommandRecord] = field(default_factory=list)
    ticks: list[TickRecord] = field(default_factory=list)
    slow_states: list[SlowState] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    outcome: str | None = None

    def put(self, record: Record) -> None:
        """Keep it."""
        kept: dict[type[Record], list[Any]] = {
            WireState: self.states,
            RobotState: self.decoded_states,
            CommandRecord: self.commands,
            TickRecord: self.ticks,
            SlowState: self.slow_states,
            EventRecord: self.events,
        }
        kept[type(record)].append(record)

    def health(self) -> SinkHealth:
        """Always well, until closed."""
        return replace(super().health(), is_alive=self.outcome is None)

    def close(self, outcome: str) -> None:
        """Keep the first outcome."""
        self.outcome = self.outcome or outcome
