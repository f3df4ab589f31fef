"""Read a log, whole or cut, into arrays."""

from __future__ import annotations

import contextlib
from collections import Counter
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from spot_log.errors import LogReadError, ManyRunsError, MissingHeaderError, NotAnMcapError, SchemaVersionError
from spot_log.format import codec
from spot_log.format.codec import ARM, COMMAND, EVENT, FOOTER, HEADER, SLOW_STATE, STATE, TICK, Topic
from spot_log.format.records import SCHEMA_NAME, RunHeader
from spot_log.read.columns import UnusualError, gather, widest, wire_columns
from spot_log.read.mcap_scan import RawMessage, Scan, scan_mcap
from spot_log.read.run import ArmTable, CommandTable, ImuTable, Run, RunFooter, SlowTable, StateTable, TickTable
from spot_log.write.run_writer import HEADER_ATTACHMENT
from spot_model.policy.observation import N_OBSERVATION
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES
from spot_protos import log_pb2

RECOVERED: Final = "recovered: "
"""How the outcome of a recovered log begins."""
MAX_IMU_PACKETS: Final = 256
"""In one state; a robot sends about five."""

M = TypeVar("M", bound=Message)


def read_run(path: str | Path) -> Run:
    """Read a log.

    A cut or damaged log is read as far as it goes; :attr:`Run.damage` says what is missing.

    Raises:
        LogReadError: The file is not a spot-rl log, or is of another version; the message says which.
        OSError: The file cannot be read.
    """
    path = Path(path)
    data = read_log_file(path)
    scan = scan_mcap(data)
    if not scan.is_mcap:
        raise NotAnMcapError(path, len(data))
    header = header_of(path, scan)
    return run_of(path, header, scan)


def read_log_file(path: Path) -> bytes:
    """A log's bytes.

    Raises:
        LogReadError: There is none, or it is a folder, a device or a pipe.
        OSError: It cannot be read.
    """
    if path.exists() and not path.is_file():
        raise LogReadError(f"{path} is not a file; give one log of spot-rl (*.mcap, or *.mcap.active after a crash)")
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise LogReadError(f"there is no log {path}; give a file written by spot-rl (*.mcap)") from error


def header_of(path: Path, scan: Scan) -> RunHeader:
    """Find the header: the record, or its copy where that is damaged.

    Raises:
        MissingHeaderError: There is neither.
        SchemaVersionError: The records are not those of this program.
        ManyRunsError: There are two that differ.
    """
    topics = scan.by_topic()
    found = [message.data for message in topics.get(HEADER.name, []) if message.schema_name == HEADER.schema_name]
    found.extend(header_copies(scan))
    if not found:
        raise MissingHeaderError(path, sorted(topics))
    try:
        headers = [codec.header_from_proto(log_pb2.Header.FromString(data)) for data in dict.fromkeys(found)]
    except DecodeError as error:
        raise MissingHeaderError(path, sorted(topics)) from error
    header = headers[0]
    if len(headers) > 1:
        raise ManyRunsError(path, [f"{run.run_id or 'unnamed'} of {run.robot_id or 'unnamed'}" for run in headers])
    if header.schema != SCHEMA_NAME:
        raise SchemaVersionError(path, header.schema, SCHEMA_NAME)
    return header


def header_copies(scan: Scan) -> list[bytes]:
    """The header's copies outside the chunks."""
    return [attachment.data for attachment in scan.attachments if attachment.name == HEADER_ATTACHMENT]


def run_of(path: Path, header: RunHeader, scan: Scan) -> Run:
    """Turn a scan into arrays.

    Raises:
        LogReadError: A record does not have the shape that the header promises.
    """
    topics = scan.by_topic()
    joints = header.joint_names or JOINT_NAMES
    feet = header.foot_names or LEG_NAMES
    commands, _ = _parse(path, topics, COMMAND, log_pb2.Command)
    ticks, _ = _parse(path, topics, TICK, log_pb2.Tick)
    slow_states, _ = _parse(path, topics, SLOW_STATE, log_pb2.SlowState)
    events, _ = _parse(path, topics, EVENT, log_pb2.Event)
    footers, _ = _parse(path, topics, FOOTER, log_pb2.Footer)
    widths = {"joints": len(joints), "feet": len(feet), "#": widest(ticks, "observation") or N_OBSERVATION}
    return Run(
        path=path,
        header=header,
        states=_state_table(path, topics, widths),
        commands=gather(CommandTable, commands, widths),
        ticks=gather(TickTable, ticks, {**widths, "joints": widest(ticks, "action") or len(joints)}),
        slow_states=_slow_table(slow_states, joints),
        events=tuple(codec.event_from_proto(message) for message in events),
        arm=gather(ArmTable, _parse(path, topics, ARM, log_pb2.Arm)[0], {}),
        footer=_footer(footers[-1]) if footers else None,
        damage=_damage_text(scan, footers[-1] if footers else None),
    )


def _damage_text(scan: Scan, footer: log_pb2.Footer | None) -> tuple[str, ...]:
    lost = [f"lost for certain: {count} of {topic}" for topic, count in sorted(scan.lost.items())]
    if footer is None:
        lost.append("the log has no footer: it was not closed, and its last half second may be missing")
        return (*scan.damage, *lost)
    counts = Counter(message.topic[1:] for message in scan.messages)
    for topic, written in sorted(footer.messages.items()):
        if counts[topic] != written and not scan.damage:
            lost.append(f"{written} of {topic} were written, {counts[topic]} are here")
    if footer.outcome.startswith(RECOVERED):
        lost.append(f"this log was {footer.outcome}")
    return (*scan.damage, *lost)


def _parse(path: Path, topics: dict[str, list[RawMessage]], topic: Topic, kind: type[M]) -> tuple[list[M], list[int]]:
    parsed: list[M] = []
    sequence: list[int] = []
    for raw in topics.get(topic.name, ()):
        if raw.schema_name != topic.schema_name:
            raise SchemaVersionError(path, raw.schema_name or "none", topic.schema_name)
        message = kind()
        try:
            message.ParseFromString(raw.data)
        except DecodeError as error:
            raise LogReadError(f"{path}: {topic.name} record {raw.sequence} cannot be decoded: {error}") from error
        parsed.append(message)
        sequence.append(raw.sequence)
    return parsed, sequence


def _state_table(path: Path, topics: dict[str, list[RawMessage]], widths: dict[str, int]) -> StateTable:
    raws = topics.get(STATE.name, [])
    if raws and all(raw.schema_name == STATE.schema_name for raw in raws):
        with contextlib.suppress(UnusualError):
            columns, imu, counts = wire_columns(
                [raw.data for raw in raws], log_pb2.State.DESCRIPTOR, StateTable, widths, "imu", ImuTable
            )
            columns["sequence"] = np.array([raw.sequence for raw in raws], dtype=np.int64)
            if counts.max() <= MAX_IMU_PACKETS:
                imu["state_index"] = np.repeat(np.arange(len(raws)), counts)
                return StateTable(imu=ImuTable(**imu) if counts.any() else ImuTable.of(0, {}), **columns)
    states, sequence = _parse(path, topics, STATE, log_pb2.State)
    return gather(StateTable, states, widths, sequence=np.array(sequence, dtype=np.int64), imu=_imu_table(states))


def _imu_table(rows: list[log_pb2.State]) -> ImuTable:
    packets: list[Any] = []
    index: list[int] = []
    for i, row in enumerate(rows):
        if len(row.imu) > MAX_IMU_PACKETS:
            raise LogReadError(f"state {i} holds {len(row.imu)} IMU packets; allowed: at most {MAX_IMU_PACKETS}")
        packets.extend(row.imu)
        index.extend([i] * len(row.imu))
    return gather(ImuTable, packets, {}, state_index=np.array(index, dtype=np.int64))


def _slow_table(rows: list[log_pb2.SlowState], joints: tuple[str, ...]) -> SlowTable:
    temperatures = [[row.motor_temperature_c.get(name, np.nan) for name in joints] for row in rows]
    lists = ("battery_temperature_c", "system_faults", "behavior_faults", "service_faults")
    return gather(
        SlowTable,
        rows,
        {},
        motor_temperature_c=np.array(temperatures, dtype=np.float64).reshape(len(rows), len(joints)),
        **{name: tuple(tuple(getattr(row, name)) for row in rows) for name in lists},
    )


def _footer(message: log_pb2.Footer) -> RunFooter:
    return RunFooter(
        host_stamp_ns=message.host_stamp_ns,
        messages=dict(sorted(message.messages.items())),
        dropped=dict(sorted(message.dropped.items())),
        outcome=message.outcome,
    )
