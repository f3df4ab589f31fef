"""Convert records to the log's protobuf messages; the reader converts back, one topic at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from spot_log.format.records import EventRecord, RunHeader, Severity
from spot_model.robot.state import RobotState, SlowState
from spot_protos import log_pb2

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
    return log_pb2.State(**{**_fields(state), "imu": [log_pb2.ImuPacket(**_fields(packet)) for packet in state.imu]})


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
    values = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values.items()}
