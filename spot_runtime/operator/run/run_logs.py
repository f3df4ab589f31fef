"""Logs of one armed robot: each begins when it is asked for, or with control, and ends when the robot stands again.

The adapter is given one sink for as long as it lives; behind it logs come and go.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from spot_log.format.events import EventName
from spot_log.format.records import RunHeader
from spot_log.write.flight_recorder import FlightRecorder
from spot_log.write.run_writer import free_path
from spot_log.write.sink import TOPICS, ForwardingSink, LogSink, NullSink
from spot_runtime.session.run import SinkFactory
from spot_runtime.stops import WANTED_ENDS


class SwitchedSink(ForwardingSink):
    """Passes everything on to the log of the moment, if there is one."""

    def __init__(self) -> None:
        super().__init__(NullSink())
        self._dropped_before = dict.fromkeys(TOPICS, 0)
        self.last = self._to.health()
        """Of the log that was closed last."""

    @property
    def is_logging(self) -> bool:
        """Whether there is a log."""
        return not isinstance(self._to, NullSink)

    def open(self, sink: LogSink) -> None:
        """Pass on to this log from now on."""
        self._to = sink

    @property
    def dropped(self) -> Mapping[str, int]:
        """What all logs so far have dropped."""
        now = self._to.dropped
        return {topic: self._dropped_before[topic] + now[topic] for topic in TOPICS}

    def close(self, outcome: str) -> None:
        """Close the log of the moment, if there is one; another may be opened."""
        before, self._to = self._to, NullSink()
        before.close(outcome)
        self.last = before.health()
        for topic, count in before.dropped.items():
            self._dropped_before[topic] += count


class NewLog(NamedTuple):
    """A log that is open."""

    path: Path
    header: RunHeader
    flight: FlightRecorder


class RunLogs:
    """Opens logs under names of their own and remembers where they are."""

    def __init__(self, make_sink: SinkFactory) -> None:
        self._make_sink, self.sink = make_sink, SwitchedSink()
        self.paths: list[Path] = []
        self._newest: NewLog | None = None
        self.loss = ""
        """What became of a log that no name leads to; empty where there is none."""

    @property
    def path(self) -> Path | None:
        """The log of the moment."""
        return self.paths[-1] if self.sink.is_logging else None

    def open(self, path: Path, header: RunHeader) -> NewLog:
        """Open a log; where the name is taken, as by a second start within a second, under the next free one.

        Raises:
            LogError: The log cannot be opened.
        """
        free = free_path(path)
        return NewLog(free, header, FlightRecorder(self._make_sink(free, header), WANTED_ENDS))

    def begin(self, log: NewLog) -> None:
        """Pass everything on to this log from now on."""
        self._newest = log
        self.sink.open(log.flight)
        self.paths.append(log.path)

    def write_flight_record(self, outcome: str) -> tuple[EventName, str] | None:
        """Write what led to a stop, if there was one in the log of the moment. Returns the event to tell."""
        log = self._newest
        return log.flight.write(log.path, log.header, outcome) if log is not None and self.sink.is_logging else None

    def end(self, outcome: str) -> None:
        """Close the log of the moment, and remember where it is."""
        is_logging = self.sink.is_logging
        self.sink.close(outcome)
        last = self.sink.last
        if is_logging and last.path is not None:
            self.paths[-1:] = [Path(last.path)] if last.path else []
            self.loss = self.loss if last.path else last.problem
