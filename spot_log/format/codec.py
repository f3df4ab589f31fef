"""Convert records to the log's protobuf messages; the reader converts back, one topic at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from spot_log.format.records import CommandRecord, EventRecord, RunHeader, Severity, TickRecord
from spot_model.robot.facts import N_JOINTS
from spot_model.robot.state import RobotState, SlowState
from spot_protos import log_pb2


@dataclass(frozen=True)
class Topic:
    """One channel of the file. The numbers are fixed, so a damaged file can still be told apart."""

    channel_id: int
    name: str
    message_type: type[Message]

    @property
    def schema_name(self) -> str:
        """Full name of the protobuf message."""
        return str(self.message_type.DESCRIPTOR.full_name)

    def schema_data(self) -> bytes:
        """Serialised FileDescriptorSet of the message's file and all that it imports."""
        return build_file_descriptor_set(self.message_type).SerializeToString()


HEADER: Final = Topic(1, "/header", log_pb2.Header)
STATE: Final = Topic(2, "/state", log_pb2.State)
COMMAND: Final = Topic(3, "/command", log_pb2.Command)
TICK: Final = Topic(4, "/tick", log_pb2.Tick)
SLOW_STATE: Final = Topic(5, "/slow_state", log_pb2.SlowState)
EVENT: Final = Topic(6, "/event", log_pb2.Event)
FOOTER: Final = Topic(7, "/footer", log_pb2.Footer)
ARM: Final = Topic(8, "/arm", log_pb2.Arm)
OWN_TOPICS: Final = (HEADER, STATE, COMMAND, TICK, SLOW_STATE, EVENT, FOOTER, ARM)

JOINT_STATES: Final = Topic(11, "/joint_states", JointStates)
TRANSFORMS: Final = Topic(12, "/tf", FrameTransforms)
ODOMETRY: Final = Topic(13, "/odometry", Odometry)
EVENT_TEXT: Final = Topic(14, "/log", Log)
SCENE: Final = Topic(15, "/scene", SceneUpdate)
VIEWER_TOPICS: Final = (JOINT_STATES, TRANSFORMS, ODOMETRY, EVENT_TEXT, SCENE)
"""What Foxglove shows without set-up; nothing of ours reads them back."""

ALL_TOPICS: Final = OWN_TOPICS + VIEWER_TOPICS


OwnRecord: TypeAlias = log_pb2.State | log_pb2.Command | log_pb2.Tick | log_pb2.SlowState | log_pb2.Event
"""What a run consists of, between its header and its footer."""

_SEVERITIES: Final = frozenset(int(severity) for severity in Severity)


def header_to_proto(header: RunHeader) -> log_pb2.Header:
    """Convert a run's header, field by field."""
    return log_pb2.Header(**_fields(header))


def header_from_proto(message: log_pb2.Header) -> RunHeader:
    """Convert a header back."""
    values = {f.name: getattr(message, f.name) for f in dataclasses.fields(RunHeader)}
    values["labels"] = dict(sorted(message.labels.items()))
    for name in ("joint_names", "foot_names"):
        values[name] = tuple(values[name])
    return RunHeader(**values)


def state_to_proto(state: RobotState) -> log_pb2.State:
    """Convert a state."""
    fields = {name: value for name, value in _fields(state).items() if not name.startswith("arm_")}
    return log_pb2.State(**{**fields, "imu": [log_pb2.ImuPacket(**_fields(packet)) for packet in state.imu]})


def command_to_proto(record: CommandRecord) -> log_pb2.Command:
    """Convert a command. Raises ValueError: an array has another length than 12."""
    command = record.command
    fields = {**_fields(command), **_fields(command.gains), **record._asdict()}
    del fields["command"], fields["gains"]
    fields["requested_position_rad"] = record.requested_position_rad.tolist()
    if any(len(value) != N_JOINTS for value in fields.values() if isinstance(value, list)):
        raise ValueError(f"arrays of other lengths than {N_JOINTS} in a command")
    return log_pb2.Command(**fields)


def tick_to_proto(record: TickRecord) -> log_pb2.Tick:
    """Convert a tick."""
    return log_pb2.Tick(**_fields(record))


def slow_state_to_proto(state: SlowState) -> log_pb2.SlowState:
    """Convert a slow state."""
    return log_pb2.SlowState(**_fields(state))


def event_to_proto(record: EventRecord) -> log_pb2.Event:
    """Convert an event."""
    return log_pb2.Event(
        host_stamp_ns=record.host_stamp_ns,
        robot_stamp_ns=record.robot_stamp_ns,
        severity=log_pb2.Event.Severity.Name(int(record.severity)),
        name=record.name,
        text=record.text,
        values={key: float(value) for key, value in record.values.items()},
    )


def event_from_proto(message: log_pb2.Event) -> EventRecord:
    """The event of a message; one whose severity is not known is information."""
    number = int(message.severity)
    return EventRecord(
        host_stamp_ns=message.host_stamp_ns,
        robot_stamp_ns=message.robot_stamp_ns,
        severity=Severity(number) if number in _SEVERITIES else Severity.INFO,
        name=message.name,
        text=message.text,
        values=dict(sorted(message.values.items())),
    )


def footer_to_proto(
    host_stamp_ns: int, messages: Mapping[str, int], dropped: Mapping[str, int], outcome: str
) -> log_pb2.Footer:
    """Build the footer: what was written, what was lost, how the run ended."""
    return log_pb2.Footer(host_stamp_ns=host_stamp_ns, messages=dict(messages), dropped=dict(dropped), outcome=outcome)


def _fields(record: Any) -> dict[str, Any]:
    """A dataclass' fields, which are named as the message's; arrays become lists."""
    values = ((name, getattr(record, name)) for name in record.__dataclass_fields__)
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values}
