"""What one step of control looks at, one snapshot of the robot and this computer, and the events that it writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from spot_log.format.events import EventName
from spot_log.format.records import EventRecord
from spot_log.write.sink import SinkHealth
from spot_model.robot.state import RobotState, SlowState
from spot_runtime.control.modes import Mode
from spot_runtime.hal.base import JointControl
from spot_runtime.host.pauses import Pause
from spot_runtime.stops import Stop


class Snapshot(NamedTuple):
    """What a step looks at, read once when it starts."""

    host_ns: int
    robot_ns: int
    states: Sequence[RobotState] = ()
    """What has arrived since the last step, oldest first."""
    joint_control: JointControl = JointControl.OFF
    problems: Sequence[Stop] = ()
    """What went wrong beside the streams since the last step."""
    slow: SlowState | None = None
    clock_age_s: float = 0.0
    """Time since the clocks were compared; 0 between two looks at the log."""
    log: SinkHealth | None = None
    """How the log is doing; None between two looks at it."""
    pause: Pause | None = None
    """Pause in which this process itself did not look; None without one, unless states are stale."""


class Phase(NamedTuple):
    """The mode, and since when; robot clock."""

    mode: Mode
    since_ns: int
    held_since_ns: int = 0
    """When the robot confirmed joint control; 0 before."""
    control_since_ns: int = 0
    """When the policy began to tick; 0 before."""
    active_since_ns: int = 0
    """When the policy came into full control; 0 before."""


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
