"""The datagrams between the loop and the log's process: packed by the one, unpacked by the other.

Each starts with its kind and the number of its topic's messages so far, those that were dropped included, so that the
receiver can count every loss. States stay the vendor's wire bytes; commands and ticks are packed by hand, because
building a protobuf costs several times as much; the rest is protobuf.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np
from google.protobuf.message import Message

from spot_log.format import codec
from spot_log.format.records import CommandRecord, EventRecord, Record, TickRecord, WireState
from spot_log.format.tables import TickTable
from spot_log.format.vendor_record import state_record_from_wire
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
_COMMAND_HEAD: Final = struct.Struct("<BIIqqqq")
# A tick's numbers stand in its head, its texts and arrays behind it, each with its length in the head.
_NUMBER_CODES: Final = {"i": "q", "f": "d", "b": "?"}
_TICK_TYPES: Final = {name: column.dtype for name, column in TickTable.columns().items()}
_TICK_NUMBERS: Final = [n for n, c in TickTable.columns().items() if c.parts is None and c.dtype.kind in _NUMBER_CODES]
_TICK_PARTS: Final = {name: dtype for name, dtype in _TICK_TYPES.items() if name not in _TICK_NUMBERS}
_TICK_CODES: Final = "".join(_NUMBER_CODES[_TICK_TYPES[name].kind] for name in _TICK_NUMBERS) + "H" * len(_TICK_PARTS)
_TICK_HEAD: Final = struct.Struct(f"<BI{_TICK_CODES}")
_tick_numbers: Final = attrgetter(*_TICK_NUMBERS)
_COMMAND_ARRAYS: Final = 6


class Datagram(NamedTuple):
    """One unpacked datagram: an own protobuf record and its number within its topic, counted from 0."""

    kind: Kind
    sequence: int
    message: log_pb2.State | log_pb2.Command | log_pb2.Tick | log_pb2.SlowState | log_pb2.Event | log_pb2.Footer


def pack(sequence: int, record: Record) -> bytes:
    """Pack a record.

    Raises:
        ValueError: An array of a command has another length than 12.
    """
    if isinstance(record, WireState):
        return _STATE_HEAD.pack(Kind.STATE_WIRE, sequence, record.host_stamp_ns) + record.wire
    if isinstance(record, CommandRecord):
        return _pack_command(sequence, record)
    if isinstance(record, TickRecord):
        return _pack_tick(sequence, record)
    kind, to_proto = _OWN[type(record)]
    return _HEAD.pack(kind, sequence) + to_proto(record).SerializeToString()


_OWN: Final[dict[type[Record], tuple[Kind, Callable[[Any], Message]]]] = {
    RobotState: (Kind.STATE, codec.state_to_proto),
    SlowState: (Kind.SLOW_STATE, codec.slow_state_to_proto),
    EventRecord: (Kind.EVENT, codec.event_to_proto),
}


def _pack_command(sequence: int, record: CommandRecord) -> bytes:
    command = record.command
    gains = command.gains
    arrays = np.array(
        (
            record.requested_position_rad,
            command.position_rad,
            command.velocity_rad_s,
            command.load_nm,
            gains.kp_nm_per_rad,
            gains.kd_nm_s_per_rad,
        ),
        dtype=np.float64,
    )
    if arrays.shape != (_COMMAND_ARRAYS, N_JOINTS):
        raise ValueError(f"command {command.key} has arrays of shape {arrays.shape[1:]}; expected ({N_JOINTS},)")
    head = _COMMAND_HEAD.pack(
        Kind.COMMAND,
        sequence,
        command.key,
        record.host_stamp_ns,
        record.robot_stamp_ns,
        record.state_robot_stamp_ns,
        command.end_robot_stamp_ns,
    )
    return head + arrays.tobytes()


def _pack_tick(sequence: int, record: TickRecord) -> bytes:
    parts = [_tick_part(getattr(record, name), dtype) for name, dtype in _TICK_PARTS.items()]
    head = _TICK_HEAD.pack(Kind.TICK, sequence, *_tick_numbers(record), *map(len, parts))
    return b"".join((head, *parts))


def pack_close(footer: log_pb2.Footer) -> bytes:
    """Pack the end of the log: outcome and drops."""
    return _HEAD.pack(Kind.CLOSE, 0) + footer.SerializeToString()


def unpack_head(datagram: bytes) -> tuple[Kind, int]:
    """Return kind and sequence number.

    Raises:
        ValueError: The datagram is too short or of no known kind.
    """
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
        return Datagram(kind, sequence, _unpack_command(datagram))
    if kind is Kind.TICK:
        return Datagram(kind, sequence, _unpack_tick(datagram))
    message = _PARSED[kind]()
    message.ParseFromString(datagram[_HEAD.size :])
    return Datagram(kind, sequence, message)


_PARSED: Final = {
    Kind.STATE: log_pb2.State,
    Kind.SLOW_STATE: log_pb2.SlowState,
    Kind.EVENT: log_pb2.Event,
    Kind.CLOSE: log_pb2.Footer,
}


def _unpack_command(datagram: bytes) -> log_pb2.Command:
    _, _, key, host_ns, robot_ns, state_ns, end_ns = _COMMAND_HEAD.unpack_from(datagram)
    arrays = np.frombuffer(datagram, dtype=np.float64, offset=_COMMAND_HEAD.size)
    requested, position, velocity, load, kp, kd = arrays.reshape(_COMMAND_ARRAYS, N_JOINTS).tolist()
    return log_pb2.Command(
        key=key,
        host_stamp_ns=host_ns,
        robot_stamp_ns=robot_ns,
        state_robot_stamp_ns=state_ns,
        end_robot_stamp_ns=end_ns,
        requested_position_rad=requested,
        position_rad=position,
        velocity_rad_s=velocity,
        load_nm=load,
        kp_nm_per_rad=kp,
        kd_nm_s_per_rad=kd,
    )


def _unpack_tick(datagram: bytes) -> log_pb2.Tick:
    _, _, *values = _TICK_HEAD.unpack_from(datagram)
    fields: dict[str, Any] = dict(zip(_TICK_NUMBERS, values, strict=False))
    offset = _TICK_HEAD.size
    for (name, dtype), length in zip(_TICK_PARTS.items(), values[len(_TICK_NUMBERS) :], strict=True):
        part = datagram[offset : offset + length]
        fields[name] = part.decode() if dtype.kind == "U" else np.frombuffer(part, dtype=dtype).tolist()
        offset += length
    return log_pb2.Tick(**fields)


def _tick_part(value: Any, dtype: np.dtype[Any]) -> bytes:
    return bytes(value.encode()) if dtype.kind == "U" else np.asarray(value, dtype=dtype).tobytes()
