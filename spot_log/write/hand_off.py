"""The datagrams between the loop and the log's process: packed by the one, unpacked by the other.

Each starts with its kind and the number of its topic's messages so far, those that were dropped included, so that the
receiver can count every loss. States stay the vendor's wire bytes; the rest is our own protobuf.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum
from typing import Any, Final, NamedTuple

from spot_log.format import codec
from spot_log.format.records import TOPIC_OF_RECORD, CommandRecord, EventRecord, Record, TickRecord, WireState
from spot_log.format.vendor_state import state_record_from_wire
from spot_model.robot.state import RobotState, SlowState
from spot_protos import log_pb2


class Kind(IntEnum):
    """What a datagram holds."""

    STATE_WIRE = 1
    STATE = 2
    COMMAND = 3
    TICK = 4
    SLOW_STATE = 5
    EVENT = 6
    CLOSE = 7


MAX_DATAGRAM_BYTES: Final = 192 * 1024
_HEAD: Final = struct.Struct("<BI")
_STATE_HEAD: Final = struct.Struct("<BIq")


class Datagram(NamedTuple):
    """One unpacked datagram: an own protobuf record and its number within its topic, counted from 0."""

    kind: Kind
    sequence: int
    message: codec.OwnRecord | log_pb2.Footer


_FORMS: Final[dict[type[Record], tuple[Kind, Callable[[Any], Any], type[Any]]]] = {
    RobotState: (Kind.STATE, codec.state_to_proto, log_pb2.State),
    CommandRecord: (Kind.COMMAND, codec.command_to_proto, log_pb2.Command),
    TickRecord: (Kind.TICK, codec.tick_to_proto, log_pb2.Tick),
    SlowState: (Kind.SLOW_STATE, codec.slow_state_to_proto, log_pb2.SlowState),
    EventRecord: (Kind.EVENT, codec.event_to_proto, log_pb2.Event),
}
"""What a record is in a datagram, what converts it, and to which message."""
_MESSAGES: Final = {kind: message for kind, _, message in _FORMS.values()} | {Kind.CLOSE: log_pb2.Footer}
TOPIC_OF_KIND: Final = {kind: TOPIC_OF_RECORD[of] for of, (kind, *_) in _FORMS.items()} | {Kind.STATE_WIRE: "state"}


def message_of(record: Record) -> codec.OwnRecord:
    """A record as it stands in the file. Raises what :func:`pack` and :func:`unpack` raise."""
    if isinstance(record, WireState):
        return state_record_from_wire(record.wire, record.host_stamp_ns)
    message: codec.OwnRecord = _FORMS[type(record)][1](record)
    return message


def pack(sequence: int, record: Record) -> bytes:
    """Pack a record. Raises ValueError: an array of a command has another length than 12."""
    if isinstance(record, WireState):
        return _STATE_HEAD.pack(Kind.STATE_WIRE, sequence, record.host_stamp_ns) + record.wire
    return _HEAD.pack(_FORMS[type(record)][0], sequence) + message_of(record).SerializeToString()


def pack_close(footer: log_pb2.Footer) -> bytes:
    """Pack the end of the log: outcome and drops."""
    return _HEAD.pack(Kind.CLOSE, 0) + footer.SerializeToString()


def unpack_head(datagram: bytes) -> tuple[Kind, int]:
    """Return kind and sequence number. Raises ValueError: the datagram is too short or of no known kind."""
    if len(datagram) < _HEAD.size:
        raise ValueError(f"datagram of {len(datagram)} bytes; expected at least {_HEAD.size}")
    kind, sequence = _HEAD.unpack_from(datagram)
    return Kind(kind), sequence


def unpack(datagram: bytes) -> Datagram:
    """Turn a datagram into the record that goes to the file.

    Raises:
        ValueError, struct.error, google.protobuf.message.DecodeError, StateMessageError: It is malformed.
    """
    kind, sequence = unpack_head(datagram)
    if kind is Kind.STATE_WIRE:
        _, _, host_stamp_ns = _STATE_HEAD.unpack_from(datagram)
        return Datagram(kind, sequence, state_record_from_wire(datagram[_STATE_HEAD.size :], host_stamp_ns))
    message = _MESSAGES[kind]()
    message.ParseFromString(datagram[_HEAD.size :])
    return Datagram(kind, sequence, message)
