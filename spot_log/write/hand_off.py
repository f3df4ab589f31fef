"""The datagrams between the loop and the log's process: packed by the one, unpacked by the other.

Each starts with its kind and the number of its topic's messages so far, those that were dropped included, so that the
receiver can count every loss. States stay the vendor's wire bytes; commands and ticks are packed by their tables'
columns, because building a protobuf costs several times as much; the rest is protobuf.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from enum import IntEnum
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from google.protobuf.message import Message

from spot_log.format import codec
from spot_log.format.records import CommandRecord, EventRecord, Record, TickRecord, WireState
from spot_log.format.tables import CommandTable, Table, TickTable
from spot_log.format.vendor_state import state_record_from_wire
from spot_model.robot.facts import N_JOINTS
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


TOPIC_OF_KIND: Final = {
    Kind.STATE_WIRE: "state",
    Kind.STATE: "state",
    Kind.COMMAND: "command",
    Kind.TICK: "tick",
    Kind.SLOW_STATE: "slow_state",
    Kind.EVENT: "event",
}
MAX_DATAGRAM_BYTES: Final = 192 * 1024
_HEAD: Final = struct.Struct("<BI")
_STATE_HEAD: Final = struct.Struct("<BIq")


class Datagram(NamedTuple):
    """One unpacked datagram: an own protobuf record and its number within its topic, counted from 0."""

    kind: Kind
    sequence: int
    message: log_pb2.State | log_pb2.Command | log_pb2.Tick | log_pb2.SlowState | log_pb2.Event | log_pb2.Footer


class _Layout:
    """A record's numbers stand in the datagram's head, its texts and arrays behind it, their lengths in the head."""

    _CODES: Final = {"i": "q", "f": "d", "b": "?"}

    def __init__(
        self, kind: Kind, table: type[Table], places: Mapping[str, str] = MappingProxyType({}), width: int | None = None
    ) -> None:
        """Pack the columns of ``table``; every array has the given width, if there is one.

        ``places`` are attributes of the record whose names are not the columns', by column.
        """
        columns = table.columns()
        self._width = width
        self._kind = kind
        self._numbers = [n for n, c in columns.items() if c.parts is None and c.dtype.kind in self._CODES]
        self._parts = {name: c.dtype for name, c in columns.items() if name not in self._numbers}
        codes = "".join(self._CODES[columns[name].dtype.kind] for name in self._numbers)
        self._head = struct.Struct(f"<BI{codes}{'H' * len(self._parts)}")
        self._numbers_of = attrgetter(*(places.get(name, name) for name in self._numbers))
        self._parts_of = attrgetter(*(places.get(name, name) for name in self._parts))

    def pack(self, sequence: int, record: Record) -> bytes:
        """The datagram of a record. Raises ValueError where an array has another width."""
        values = self._parts_of(record)
        if self._width is not None and any(len(value) != self._width for value in values):
            raise ValueError(f"arrays of {[len(value) for value in values]} values; expected {self._width} in each")
        given = zip(values, self._parts.values(), strict=True)
        parts = [v.encode() if dtype.kind == "U" else np.asarray(v, dtype=dtype).tobytes() for v, dtype in given]
        head = self._head.pack(self._kind, sequence, *self._numbers_of(record), *map(len, parts))
        return b"".join((head, *parts))

    def unpack(self, datagram: bytes) -> dict[str, Any]:
        """The record's fields by name."""
        _, _, *values = self._head.unpack_from(datagram)
        fields: dict[str, Any] = dict(zip(self._numbers, values, strict=False))
        offset = self._head.size
        for (name, dtype), length in zip(self._parts.items(), values[len(self._numbers) :], strict=True):
            part = datagram[offset : offset + length]
            fields[name] = part.decode() if dtype.kind == "U" else np.frombuffer(part, dtype=dtype).tolist()
            offset += length
        return fields


_COMMAND: Final = _Layout(
    Kind.COMMAND,
    CommandTable,
    {
        **{
            name: f"command.{name}"
            for name in ("key", "end_robot_stamp_ns", "position_rad", "velocity_rad_s", "load_nm")
        },
        **{name: f"command.gains.{name}" for name in ("kp_nm_per_rad", "kd_nm_s_per_rad")},
    },
    width=N_JOINTS,
)
_TICK: Final = _Layout(Kind.TICK, TickTable)
_OWN: Final[dict[type[Record], tuple[Kind, Callable[[Any], Message]]]] = {
    RobotState: (Kind.STATE, codec.state_to_proto),
    SlowState: (Kind.SLOW_STATE, codec.slow_state_to_proto),
    EventRecord: (Kind.EVENT, codec.event_to_proto),
}
_PARSED: Final = {
    Kind.STATE: log_pb2.State,
    Kind.SLOW_STATE: log_pb2.SlowState,
    Kind.EVENT: log_pb2.Event,
    Kind.CLOSE: log_pb2.Footer,
}


def pack(sequence: int, record: Record) -> bytes:
    """Pack a record. Raises ValueError: an array of a command has another length than 12."""
    if isinstance(record, WireState):
        return _STATE_HEAD.pack(Kind.STATE_WIRE, sequence, record.host_stamp_ns) + record.wire
    if isinstance(record, CommandRecord):
        return _COMMAND.pack(sequence, record)
    if isinstance(record, TickRecord):
        return _TICK.pack(sequence, record)
    kind, to_proto = _OWN[type(record)]
    return _HEAD.pack(kind, sequence) + to_proto(record).SerializeToString()


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
    if kind is Kind.COMMAND:
        return Datagram(kind, sequence, log_pb2.Command(**_COMMAND.unpack(datagram)))
    if kind is Kind.TICK:
        return Datagram(kind, sequence, log_pb2.Tick(**_TICK.unpack(datagram)))
    message = _PARSED[kind]()
    message.ParseFromString(datagram[_HEAD.size :])
    return Datagram(kind, sequence, message)
