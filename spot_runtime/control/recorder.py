"""Writes what the loop does to its log, and tells the console of events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.events import EventName
from spot_log.format.records import CommandRecord, EventRecord, TickRecord
from spot_log.write.sink import LogSink, SinkHealth
from spot_model.robot.state import Array, JointCommand, RobotState
from spot_runtime.control.tick import TickResult
from spot_runtime.hal.base import Hal

NS_PER_S: Final = 1_000_000_000
_NOTHING: Final[NDArray[np.float32]] = np.zeros(0, dtype=np.float32)


class Recorder:
    """Turns what happened into records; nothing here blocks."""

    def __init__(self, hal: Hal, sink: LogSink, on_event: Callable[[EventRecord], None]) -> None:
        """Stamp with the clocks of ``hal``; tell ``on_event`` of every event, too."""
        self._hal, self._sink, self._on_event = hal, sink, on_event
        self._told: set[EventName] = set()

    def event(self, name: EventName, text: str, values: Mapping[str, float] | None = None) -> None:
        """Write an event."""
        host_ns, robot_ns = self._hal.host_now_ns(), self._hal.robot_now_ns()
        record = EventRecord(host_ns, robot_ns, name.severity, name.label, text, dict(values or {}))
        self._sink.event(record)
        self._on_event(record)

    def once(self, name: EventName, text: str, values: Mapping[str, float] | None = None) -> None:
        """Write an event whose repetitions would only flood the log."""
        if name not in self._told:
            self._told.add(name)
            self.event(name, text, values)

    def command(
        self, command: JointCommand, requested_rad: Array, *, host_ns: int, robot_ns: int, state: RobotState | None
    ) -> None:
        """Write a command as it was sent, at these instants, beside what was requested."""
        state_ns = 0 if state is None else state.robot_stamp_ns
        self._sink.command(CommandRecord(command, requested_rad, host_ns, robot_ns, state_ns))

    def tick(
        self,
        *,
        index: int,
        state: RobotState,
        host_ns: int,
        mode: str,
        result: TickResult | None,
        velocity_command: Array,
        inference_s: float,
        compute_s: float,
        key: int,
        skipped: int,
    ) -> float:
        """Write a tick. Returns the age of its state, s."""
        state_age_s = (host_ns - state.host_stamp_ns) / NS_PER_S
        self._sink.tick(
            TickRecord(
                index=index,
                robot_stamp_ns=state.robot_stamp_ns,
                host_stamp_ns=host_ns,
                mode=mode,
                observation=_NOTHING if result is None else result.observation,
                action=_NOTHING if result is None else result.action,
                velocity_command=velocity_command,
                state_age_s=state_age_s,
                inference_s=inference_s,
                compute_s=compute_s,
                command_key=key,
                skipped=skipped,
            )
        )
        return state_age_s

    def health(self) -> SinkHealth:
        """How the log is doing; a problem becomes an event, once."""
        health = self._sink.health()
        if health.problem:
            self.once(EventName.LOG_PROBLEM, health.problem)
        return health
