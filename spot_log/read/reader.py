"""Read a log, whole or cut, into arrays."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from google.protobuf.message import DecodeError
from mcap.reader import SeekingReader

from spot_log.errors import LogReadError, ManyRunsError, MissingHeaderError, NotAnMcapError, SchemaVersionError
from spot_log.format import codec
from spot_log.format.codec import ARM, COMMAND, EVENT, FOOTER, HEADER, SLOW_STATE, STATE, TICK, Topic
from spot_log.format.records import SCHEMA_NAME, RunHeader
from spot_log.format.tables import Table
from spot_log.read.chunks import PARSE_ERRORS
from spot_log.read.columns import Parsed, UnusualError, Wire
from spot_log.read.mcap_scan import Scan, scan_mcap
from spot_log.read.run import ArmTable, CommandTable, ImuTable, Ints, Run, RunFooter, SlowTable, StateTable, TickTable
from spot_log.write.mcap_file import MAGIC
from spot_log.write.run_writer import HEADER_ATTACHMENT
from spot_model.policy.observation import N_OBSERVATION
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES
from spot_protos import log_pb2

RECOVERED: Final = "recovered: "
"""How the outcome of a recovered log begins."""
MAX_IMU_PACKETS: Final = 256
"""In one state; a robot sends about five."""

TableT = TypeVar("TableT", bound=Table)


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


class _Opened(Run):
    """A run of which only the header was read; all else is read when something of it is first asked for."""

    def __getattr__(self, name: str) -> Any:
        if name not in Run.__dataclass_fields__ or "path" not in vars(self):
            raise AttributeError(f"a run has no {name!r}")
        vars(self).update(vars(read_run(self.path)))
        return vars(self)[name]


def open_run(path: str | Path) -> Run:
    """Open a log: read its header now, and all else when something of it is first asked for.

    A log that was not closed, or does not have exactly one header, is read at once.

    Raises:
        LogReadError: As :func:`read_run` does; what is wrong behind the header is raised when it is read.
        OSError: The file cannot be read.
    """
    path, scan = Path(path), Scan()
    with contextlib.suppress(*PARSE_ERRORS, OSError, StopIteration), path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
        if summary and summary.statistics:
            numbers = [channel.id for channel in summary.channels.values() if channel.topic == HEADER.name]
            counts = [summary.statistics.channel_message_counts.get(number, 0) for number in numbers]
            copies = [index for index in summary.attachment_indexes if index.name == HEADER_ATTACHMENT]
            if sum(counts) == len(copies) == 1:
                file.seek(copies[0].offset)
                scan = scan_mcap(MAGIC + file.read(copies[0].length))
    if len(header_copies(scan)) != 1:
        return read_run(path)
    run = object.__new__(_Opened)
    vars(run).update(path=path, header=header_of(path, scan))
    return run


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
    topics = scan.counts
    found = [*scan.of(HEADER.name, HEADER.schema_name).data(), *header_copies(scan)]
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
    """Turn a scan into arrays. Raises LogReadError: a record does not have the shape that the header promises."""
    joints = header.joint_names or JOINT_NAMES
    widths = {"joints": len(joints), "feet": len(header.foot_names or LEG_NAMES)}
    footers = _parsed(path, scan, FOOTER).messages
    return Run(
        path=path,
        header=header,
        states=_table(path, scan, STATE, lambda source: _state_table(source, widths, scan.of(STATE.name).sequence)),
        commands=_table(path, scan, COMMAND, lambda source: source.table(CommandTable, widths)),
        ticks=_table(path, scan, TICK, lambda source: _tick_table(source, len(joints))),
        slow_states=_slow_table(_parsed(path, scan, SLOW_STATE), joints),
        events=tuple(codec.event_from_proto(message) for message in _parsed(path, scan, EVENT).messages),
        arm=_table(path, scan, ARM, lambda source: source.table(ArmTable, {})),
        footer=_footer(footers[-1]) if footers else None,
        damage=_damage_text(scan, footers[-1] if footers else None),
    )


def _damage_text(scan: Scan, footer: log_pb2.Footer | None) -> tuple[str, ...]:
    lost = [f"lost for certain: {count} of {topic}" for topic, count in sorted(scan.lost.items())]
    if footer is None:
        lost.append("the log has no footer: it was not closed, and its last half second may be missing")
        return (*scan.damage, *lost)
    for topic, written in sorted(footer.messages.items()):
        if (here := scan.counts["/" + topic]) != written and not scan.damage:
            lost.append(f"{written} of {topic} were written, {here} are here")
    if footer.outcome.startswith(RECOVERED):
        lost.append(f"this log was {footer.outcome}")
    return (*scan.damage, *lost)


def _parsed(path: Path, scan: Scan, topic: Topic) -> Parsed:
    rows, parsed = scan.of(topic.name), []
    for other in sorted(rows.schema_names - {topic.schema_name}):
        raise SchemaVersionError(path, other or "none", topic.schema_name)
    for data, number in zip(rows.data(), rows.sequence, strict=True):
        try:
            parsed.append(topic.message_type.FromString(data))
        except DecodeError as error:  # noqa: PERF203 - the message names the record
            raise LogReadError(f"{path}: {topic.name} record {number} cannot be decoded: {error}") from error
    return Parsed(parsed)


def _table(path: Path, scan: Scan, topic: Topic, made_of: Callable[[Wire | Parsed], TableT]) -> TableT:
    """A topic's table, from its wire bytes if they are as usual."""
    rows = scan.of(topic.name)
    with contextlib.suppress(UnusualError):
        if rows.schema_names == {topic.schema_name}:
            return made_of(Wire.of(rows.buffer, rows.starts, rows.lengths, topic.message_type.DESCRIPTOR))
    return made_of(_parsed(path, scan, topic))


def _state_table(source: Wire | Parsed, widths: dict[str, int], sequence: Ints) -> StateTable:
    packets, counts = source.part("imu")
    if (too_many := counts > MAX_IMU_PACKETS).any():
        i = int(np.argmax(too_many))
        raise LogReadError(f"state {i} holds {counts[i]} IMU packets; allowed: at most {MAX_IMU_PACKETS}")
    imu = packets.table(ImuTable, {}, state_index=np.repeat(np.arange(len(counts)), counts))
    return source.table(StateTable, widths, sequence=sequence, imu=imu)


def _tick_table(source: Wire | Parsed, n_joints: int) -> TickTable:
    widths = {"#": source.widest("observation") or N_OBSERVATION, "joints": source.widest("action") or n_joints}
    return source.table(TickTable, widths)


def _slow_table(parsed: Parsed, joints: tuple[str, ...]) -> SlowTable:
    rows = parsed.messages
    temperatures = [[row.motor_temperature_c.get(name, np.nan) for name in joints] for row in rows]
    lists = ("battery_temperature_c", "system_faults", "behavior_faults", "service_faults")
    return parsed.table(
        SlowTable,
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
