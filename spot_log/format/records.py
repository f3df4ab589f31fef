"""What the loop hands to the log: small immutable tuples, cheap to build, arrays in canonical joint order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, Array
from spot_model.robot.state import JointCommand, RobotState, SlowState

SCHEMA_NAME: Final = "spot-rl/log/1"
"""Name and version of the log's records, in every header."""


class Severity(IntEnum):
    """How much an event matters; the numbers are those of log.proto."""

    INFO = 1
    WARNING = 2
    ERROR = 3


@dataclass(frozen=True)
class RunHeader:
    """What is known before the first state; written once, first."""

    run_id: str
    """Unique, hexadecimal."""
    started_host_stamp_ns: int
    """When the run began, host clock."""
    robot_id: str = ""
    """Value of ``--robot``."""
    adapter: str = ""
    """The HAL adapter: ``spot``, or one of your own."""
    policy_name: str = ""
    """Name of the policy; empty if none ran."""
    policy_sha256: str = ""
    """Digest of the policy's file, by which ``simulate`` and ``diagnose`` find it."""
    policy_contract_json: str = ""
    """The policy's contract, as in ``Policy.contract``."""
    config_json: str = ""
    """The whole run configuration."""
    command_sequence: str = ""
    """Name of the sequence of velocity commands."""
    repeat: int = 0
    """Number of the run of that sequence, from 0."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """From ``--label``."""
    software_version: str = ""
    """Version of spot-rl."""
    software_revision: str = ""
    """Revision of its sources, if known."""
    joint_names: tuple[str, ...] = JOINT_NAMES
    """Order of the joints in every array."""
    foot_names: tuple[str, ...] = LEG_NAMES
    """Order of the feet."""
    schema: str = SCHEMA_NAME
    """Version of the log's format."""


class WireState(NamedTuple):
    """A state as the wire bytes of a vendor ``RobotStateStreamResponse``, and when it was received."""

    wire: bytes
    host_stamp_ns: int


class CommandRecord(NamedTuple):
    """One command as it was handed to the stream."""

    command: JointCommand
    requested_position_rad: Array
    """What the policy or the ramp asked for, before the limits. Shape (12,)."""
    host_stamp_ns: int
    """When it was handed to the stream, host clock."""
    robot_stamp_ns: int
    """The same instant by the estimated robot clock; 0 where there is no estimate."""
    state_robot_stamp_ns: int
    """Stamp of the state that it answers; 0 where it answers none."""


@dataclass(frozen=True, slots=True)
class TickRecord:
    """One 50 Hz policy tick."""

    index: int
    robot_stamp_ns: int
    """Stamp of the state that the tick saw, robot clock."""
    host_stamp_ns: int
    """When the tick began, host clock."""
    mode: str
    observation: NDArray[np.float32]
    """Shape (48,), or empty outside the policy's mode."""
    action: NDArray[np.float32]
    """Shape (12,), or empty."""
    velocity_command: Array
    """V_x, V_y (m/s), ω_z (rad/s). Shape (3,)."""
    state_age_s: float
    """From the receipt of the state to the start of the tick."""
    inference_s: float
    compute_s: float
    """The whole tick, inference included."""
    command_key: int
    skipped: int
    """Ticks lost between the one before and this one."""


class EventRecord(NamedTuple):
    """One event."""

    host_stamp_ns: int
    """When it happened, host clock."""
    robot_stamp_ns: int
    """The same instant by the estimated robot clock; 0 where there is no estimate."""
    severity: Severity
    """info, warning or error."""
    name: str
    """What happened, such as `mode` or `stop`."""
    text: str
    """One sentence for a person."""
    values: Mapping[str, float] = {}
    """Measured value, bound and the like, unit in the key."""


Record: TypeAlias = WireState | RobotState | CommandRecord | TickRecord | SlowState | EventRecord
"""All that the loop logs; decoded states come from an adapter that has no wire bytes."""

TOPIC_OF_RECORD: Final[Mapping[type[Record], str]] = {
    WireState: "state",
    RobotState: "state",
    CommandRecord: "command",
    TickRecord: "tick",
    SlowState: "slow_state",
    EventRecord: "event",
}
