"""Write a foreign recording as a log: a state a row, and a command, tick or poll where they are mapped.

Signals that the recording lacks stay empty and are listed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from collections.abc import Mapping as Columns
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spot_log.format import codec
from spot_log.format.codec import OwnRecord
from spot_log.format.events import EventName
from spot_log.format.records import EventRecord, RunHeader
from spot_log.importing.checks import Mismatch, doubts_of
from spot_log.importing.mapping import SIGNALS, Mapping, signals_of
from spot_log.importing.recording import ForeignRecording
from spot_log.write.run_writer import RunWriter, check_can_start
from spot_model.errors import BadInputError
from spot_model.io.whole import whole_file
from spot_model.robot.facts import Array
from spot_model.robot.rotation import rotate_wxyz
from spot_protos import log_pb2

SET_POINTS = ("setpoint_position", "setpoint_velocity", "feedforward")


@dataclass(frozen=True)
class Imported:
    """What came of an import."""

    path: Path
    rows: int
    rate_hz: float
    missing: tuple[str, ...]
    """Signals that the recording does not have."""
    doubts: tuple[str, ...]
    """What probably is not as the mapping says; the log repeats it."""


def import_log(mapping: Mapping, source: Path, result: Path) -> Imported:
    """Write the recording ``source`` as the log ``result``.

    Raises:
        BadInputError: A signal is missing, differs from the mapping, or cannot be as it says. Nothing is left behind.
        LogError: ``result`` exists, or the disk is too full.
        OSError: A file cannot be read or written.
    """
    check_can_start(result)
    recording = ForeignRecording(source, mapping)
    doubts = doubts_of(recording)
    certain = [doubt.text for doubt in doubts if doubt.is_certain]
    if certain and not mapping.accept_doubts:
        more = "correct the mapping; 'accept_doubts: true' in it writes the log all the same"
        raise BadInputError(f"{source} is not what the mapping says: {'; '.join(certain)}; {more}")
    records = [*_doubted(recording, doubts), *records_of(recording)]
    header = RunHeader(
        run_id=source.stem + (f"-episode-{mapping.episode}" if mapping.episode is not None else ""),
        started_host_stamp_ns=int(recording.stamps_ns[0]),
        robot_id=mapping.robot,
        adapter="import",
        config_json=json.dumps(
            {"imported_from": source.name, "mapping": mapping.model_dump(mode="json", by_alias=True)}
        ),
        command_sequence=mapping.command_sequence,
        repeat=mapping.repeat,
        labels=mapping.labels,
        joint_names=mapping.joint_names,
        foot_names=mapping.foot_names,
    )
    with whole_file(result) as part:
        _write(part, header, records)
    stamps = recording.stamps_ns[recording.rows_with(*signals_of("state"))]
    rate = (len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9) if len(stamps) > 1 else float("nan")
    return Imported(result, len(stamps), float(rate), _missing(mapping), tuple(doubt.text for doubt in doubts))


def _doubted(recording: ForeignRecording, doubts: Sequence[Mismatch]) -> list[OwnRecord]:
    """An event a doubt, at the first stamp."""
    name, first_ns = EventName.IMPORT_DOUBTED, int(recording.stamps_ns[0])
    events = [EventRecord(first_ns, first_ns, name.severity, name.label, doubt.text) for doubt in doubts]
    return [codec.event_to_proto(event) for event in events]


def _missing(mapping: Mapping) -> tuple[str, ...]:
    """Signals that are not mapped; of a velocity of the body, either axes do."""
    found = {name.replace("_in_body", "_in_odom") for name in mapping.signals}
    return (*(name for name in SIGNALS if not name.endswith("_in_body") and name not in found), "echoed command keys")


def _write(result: Path, header: RunHeader, records: list[OwnRecord]) -> None:
    writer = RunWriter(result, header)
    numbers: dict[type, int] = {}
    try:
        for record in records:
            number = numbers.get(type(record), 0)
            numbers[type(record)] = number + 1
            writer.add(record, number)
            if writer.is_chunk_full:
                writer.flush()
        writer.close({}, "imported")
    except BaseException:
        writer.abandon()
        raise


def records_of(recording: ForeignRecording) -> list[OwnRecord]:
    """What the log will hold, oldest first. Raises BadInputError, OSError."""
    records = [*_states(recording), *_commands(recording), *_ticks(recording), *_slow_states(recording)]
    return sorted(records, key=lambda record: record.host_stamp_ns)


def _states(recording: ForeignRecording) -> list[OwnRecord]:
    columns = _columns(recording, "state")
    for name, unit in (("linear_vel_of_body", "m_s"), ("angular_vel_of_body", "rad_s")):
        velocity = _in_odom(recording, name)
        if velocity is not None:
            columns[f"{name}_in_odom_{unit}"] = velocity.tolist()
    if recording.has("foot_contact"):
        contact = recording.signal("foot_contact") > 0.5
        if contact.shape[1] != len(recording.mapping.foot_names):
            names = ", ".join(recording.mapping.foot_names)
            raise BadInputError(f"signal foot_contact has {contact.shape[1]} columns; foot_names are {names}")
        columns["foot_contact"] = contact.tolist()
    measured = {"acceleration_of_imu_in_link": "m_s2", "angular_vel_of_link_in_link": "rad_s"}
    if imu := {f"{n}_{unit}": recording.signal(n).tolist() for n, unit in measured.items() if recording.has(n)}:
        imu["robot_stamp_ns"] = recording.stamps_ns.tolist()
        columns["imu"] = [[log_pb2.ImuPacket(**row)] for row in _rows(imu)]
    return _records(log_pb2.State, recording, signals_of("state"), columns)


def _commands(recording: ForeignRecording) -> list[OwnRecord]:
    if not any(map(recording.has, SET_POINTS)):
        return []
    key = np.cumsum(recording.rows_with(*SET_POINTS)).tolist()
    return _records(log_pb2.Command, recording, SET_POINTS, {**_columns(recording, "command"), "key": key})


def _ticks(recording: ForeignRecording) -> list[OwnRecord]:
    columns, signals = _columns(recording, "tick"), signals_of("tick")
    if not columns:
        return []
    columns["index"] = (np.cumsum(recording.rows_with(*signals)) - 1).clip(0).tolist()
    unknown = dict.fromkeys(("state_age_s", "inference_s", "compute_s"), math.nan)
    return _records(log_pb2.Tick, recording, signals, columns, mode="imported", **unknown)


def _slow_states(recording: ForeignRecording) -> list[OwnRecord]:
    """A poll every 0.1 s at most: these signals are slow, whatever the rate of the recording."""
    signals = [name for name in signals_of("slow") if recording.has(name)]
    if not signals:
        return []
    stamps_ns, polls = recording.stamps_ns, list[OwnRecord]()
    unknown: dict[str, Any] = {SIGNALS[name].field: math.nan for name in signals_of("slow") if SIGNALS[name].field}
    some = np.flatnonzero(recording.rows_with(*signals))
    for row in some[np.diff(stamps_ns[some] // 100_000_000, prepend=-1) > 0]:
        given = {name: recording.signal(name)[row].tolist() for name in signals}
        fields = unknown | {field: values[0] for name, values in given.items() if (field := SIGNALS[name].field)}
        if celsius := given.get("motor_temperature"):
            fields["motor_temperature_c"] = dict(zip(recording.mapping.joint_names, celsius, strict=True))
        ns = int(stamps_ns[row])
        polls.append(log_pb2.SlowState(robot_stamp_ns=ns, host_stamp_ns=ns, motors_powered=True, **fields))
    return polls


def _in_odom(recording: ForeignRecording, name: str) -> Array | None:
    """A velocity of the body in the axes of odom, shape (n, 3); None where it is not mapped."""
    if recording.has(f"{name}_in_odom"):
        return recording.signal(f"{name}_in_odom")
    if not recording.has(f"{name}_in_body"):
        return None
    if not recording.has("odom_from_body"):
        raise BadInputError(f"signal {name}_in_body needs the signal odom_from_body, which tells how the body lies")
    return np.asarray(rotate_wxyz(recording.signal("odom_from_body"), recording.signal(f"{name}_in_body")))


def _columns(recording: ForeignRecording, record: str) -> dict[str, Sequence[Any]]:
    """Those mapped signals that a record holds as they are, by its fields."""
    fields = {name: SIGNALS[name].field for name in signals_of(record) if recording.has(name)}
    return {field: recording.signal(name).tolist() for name, field in fields.items() if field}


def _records(
    kind: type[Any],
    recording: ForeignRecording,
    signals: Iterable[str],
    columns: Columns[str, Sequence[Any]],
    **same: Any,
) -> list[OwnRecord]:
    """One record a row in which one of the signals has a value."""
    rows = zip(recording.stamps_ns.tolist(), recording.rows_with(*signals).tolist(), _rows(columns), strict=True)
    return [kind(robot_stamp_ns=ns, host_stamp_ns=ns, **row, **same) for ns, is_given, row in rows if is_given]


def _rows(columns: Columns[str, Sequence[Any]]) -> list[dict[str, Any]]:
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
