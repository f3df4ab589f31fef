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
from spot_log.format.events import EventName
from spot_log.format.records import EventRecord, RunHeader
from spot_log.importing.checks import Doubt, doubts_of
from spot_log.importing.mapping import SIGNALS, Mapping, record_of
from spot_log.importing.recording import Recording
from spot_log.write.run_writer import RunWriter, check_can_start
from spot_model.errors import BadInputError
from spot_model.io.whole import whole_file
from spot_model.robot.rotation import rotate_wxyz
from spot_model.robot.state import Array
from spot_protos import log_pb2

SLOW_PERIOD_NS = 100_000_000
STATE_FIELDS = {
    "position": "position_rad",
    "velocity": "velocity_rad_s",
    "load": "load_nm",
    "position_of_body_in_odom": "position_of_body_in_odom_m",
    "odom_from_body": "odom_from_body_wxyz",
}
IMU_FIELDS = {
    "acceleration_of_imu_in_link": "acceleration_of_imu_in_link_m_s2",
    "angular_vel_of_link_in_link": "angular_vel_of_link_in_link_rad_s",
}
SET_POINT_FIELDS = {
    "setpoint_position": "position_rad",
    "setpoint_velocity": "velocity_rad_s",
    "feedforward": "load_nm",
}
GAIN_FIELDS = {"kp": "kp_nm_per_rad", "kd": "kd_nm_s_per_rad"}
TICK_FIELDS = {name: name for name in ("velocity_command", "action", "observation")}
BATTERY_FIELDS = {
    "battery_voltage": "battery_voltage_v",
    "battery_current": "battery_current_a",
    "battery_charge": "battery_charge_percent",
}
"""Signals of a mapping, and the fields of the log's records that they fill."""
_COMPLETE = (
    "velocity",
    "load",
    "setpoint_position",
    "kp",
    "kd",
    "odom_from_body",
    "foot_contact",
    "velocity_command",
    "action",
    "observation",
    "battery_voltage",
    "battery_current",
    "motor_temperature",
)

STATE_SIGNALS = tuple(name for name in SIGNALS if record_of(name) == "state")

Record = log_pb2.State | log_pb2.Command | log_pb2.Tick | log_pb2.SlowState | log_pb2.Event


@dataclass(frozen=True)
class Imported:
    """What came of an import."""

    path: Path
    rows: int
    rate_hz: float
    missing: tuple[str, ...]
    """Signals of a complete log that the recording does not have."""
    doubts: tuple[str, ...]
    """What probably is not as the mapping says; the log repeats it."""


def import_log(mapping: Mapping, source: Path, result: Path, run_id: str = "") -> Imported:
    """Write the recording ``source`` as the log ``result``.

    Raises:
        BadInputError: A signal is missing, differs from the mapping, or cannot be as it says. Nothing is left behind.
        LogError: ``result`` exists, or the disk is too full.
        OSError: A file cannot be read or written.
    """
    check_can_start(result)
    recording = Recording(source, mapping)
    doubts = doubts_of(recording)
    certain = [doubt.text for doubt in doubts if doubt.is_certain]
    if certain and not mapping.accept_doubts:
        more = "correct the mapping; 'accept_doubts: true' in it writes the log all the same"
        raise BadInputError(f"{source} is not what the mapping says: {'; '.join(certain)}; {more}")
    records = [*_doubted(recording, doubts), *records_of(recording)]
    header = RunHeader(
        run_id=run_id or source.stem,
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
    stamps = recording.stamps_ns[recording.rows_with(*STATE_SIGNALS)]
    rate = (len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9) if len(stamps) > 1 else float("nan")
    return Imported(result, len(stamps), float(rate), _missing(mapping), tuple(doubt.text for doubt in doubts))


def _doubted(recording: Recording, doubts: Sequence[Doubt]) -> list[Record]:
    """An event a doubt, at the first stamp."""
    name, first_ns = EventName.IMPORT_DOUBTED, int(recording.stamps_ns[0])
    events = [EventRecord(first_ns, first_ns, name.severity, name.label, doubt.text) for doubt in doubts]
    return [codec.event_to_proto(event) for event in events]


def _missing(mapping: Mapping) -> tuple[str, ...]:
    found = set(mapping.signals)
    missing = [name for name in _COMPLETE if name not in found]
    missing += [
        quantity
        for quantity in ("linear_vel_of_body", "angular_vel_of_body")
        if not {f"{quantity}_in_odom", f"{quantity}_in_body"} & found
    ]
    return (*missing, "echoed command keys")


def _write(result: Path, header: RunHeader, records: list[Record]) -> None:
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


def records_of(recording: Recording) -> list[Record]:
    """What the log will hold, oldest first. Raises BadInputError, OSError."""
    records = [*_states(recording), *_commands(recording), *_ticks(recording), *_slow_states(recording)]
    return sorted(records, key=lambda record: record.host_stamp_ns)


def _states(recording: Recording) -> list[Record]:
    columns = _columns(recording, STATE_FIELDS)
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
    imu = _columns(recording, IMU_FIELDS)
    if imu:
        imu["robot_stamp_ns"] = recording.stamps_ns.tolist()
        columns["imu"] = [[log_pb2.ImuPacket(**row)] for row in _rows(imu)]
    return _records(log_pb2.State, recording, STATE_SIGNALS, columns)


def _commands(recording: Recording) -> list[Record]:
    columns = _columns(recording, SET_POINT_FIELDS)
    if not columns:
        return []
    columns |= _columns(recording, GAIN_FIELDS)
    columns["key"] = np.cumsum(recording.rows_with(*SET_POINT_FIELDS)).tolist()
    return _records(log_pb2.Command, recording, SET_POINT_FIELDS, columns)


def _ticks(recording: Recording) -> list[Record]:
    columns = _columns(recording, TICK_FIELDS)
    if not columns:
        return []
    columns["index"] = (np.cumsum(recording.rows_with(*TICK_FIELDS)) - 1).clip(0).tolist()
    unknown = {"state_age_s": math.nan, "inference_s": math.nan, "compute_s": math.nan}
    return _records(log_pb2.Tick, recording, TICK_FIELDS, columns, mode="imported", **unknown)


def _slow_states(recording: Recording) -> list[Record]:
    """A poll every 0.1 s at most: these signals are slow, whatever the rate of the recording."""
    battery = {field: recording.signal(name)[:, 0] for name, field in BATTERY_FIELDS.items() if recording.has(name)}
    has_motors = recording.has("motor_temperature")
    if not battery and not has_motors:
        return []
    stamps_ns = recording.stamps_ns
    some = np.flatnonzero(recording.rows_with(*BATTERY_FIELDS, "motor_temperature"))
    chosen = some[np.diff(stamps_ns[some] // SLOW_PERIOD_NS, prepend=-1) > 0]
    columns: dict[str, Sequence[Any]] = {
        field: battery[field][chosen].tolist() if field in battery else [math.nan] * len(chosen)
        for field in BATTERY_FIELDS.values()
    }
    if has_motors:
        temperatures = recording.signal("motor_temperature")[chosen].tolist()
        columns["motor_temperature_c"] = [
            dict(zip(recording.mapping.joint_names, row, strict=True)) for row in temperatures
        ]
    return [
        log_pb2.SlowState(robot_stamp_ns=ns, host_stamp_ns=ns, motors_powered=True, **row)
        for ns, row in zip(stamps_ns[chosen].tolist(), _rows(columns), strict=True)
    ]


def _in_odom(recording: Recording, name: str) -> Array | None:
    """A velocity of the body in the axes of odom, shape (n, 3); None where it is not mapped."""
    if recording.has(f"{name}_in_odom"):
        return recording.signal(f"{name}_in_odom")
    if not recording.has(f"{name}_in_body"):
        return None
    if not recording.has("odom_from_body"):
        raise BadInputError(f"signal {name}_in_body needs the signal odom_from_body, which tells how the body lies")
    return np.asarray(rotate_wxyz(recording.signal("odom_from_body"), recording.signal(f"{name}_in_body")))


def _columns(recording: Recording, fields: Columns[str, str]) -> dict[str, Sequence[Any]]:
    """Those signals that are mapped, by the field of the record."""
    return {field: recording.signal(name).tolist() for name, field in fields.items() if recording.has(name)}


def _records(
    kind: type[Any], recording: Recording, signals: Iterable[str], columns: Columns[str, Sequence[Any]], **same: Any
) -> list[Record]:
    """One record a row in which one of the signals has a value."""
    rows = zip(recording.stamps_ns.tolist(), recording.rows_with(*signals).tolist(), _rows(columns), strict=True)
    return [kind(robot_stamp_ns=ns, host_stamp_ns=ns, **row, **same) for ns, is_given, row in rows if is_given]


def _rows(columns: Columns[str, Sequence[Any]]) -> list[dict[str, Any]]:
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
