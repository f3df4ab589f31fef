"""Write a foreign recording as a log; signals that it lacks stay empty and are listed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from spot_log.format.records import RunHeader
from spot_log.importing.mapping import Mapping
from spot_log.importing.rows import Record, records_of
from spot_log.importing.signals import Recording
from spot_log.write.run_writer import RunWriter, check_can_start
from spot_model.io.whole import whole_file

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


@dataclass(frozen=True)
class Imported:
    """What came of an import."""

    path: Path
    rows: int
    rate_hz: float
    missing: tuple[str, ...]
    """Signals of a complete log that the recording does not have."""


def import_log(mapping: Mapping, source: Path, result: Path, run_id: str = "") -> Imported:
    """Write the recording ``source`` as the log ``result``: a state a row, and a command, tick or poll where mapped.

    Raises:
        BadInputError: A signal is missing or differs from the mapping. Nothing is left behind.
        LogError: ``result`` exists, or the disk is too full.
        OSError: A file cannot be read or written.
    """
    check_can_start(result)
    recording = Recording(source, mapping)
    records = records_of(recording)
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
    stamps = recording.stamps_ns
    rate = (len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9) if len(stamps) > 1 else float("nan")
    return Imported(result, len(stamps), float(rate), _missing(mapping))


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
