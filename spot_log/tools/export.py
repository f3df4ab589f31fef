"""Write a run's tables as Parquet or CSV files, one a topic."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.format.records import Severity
from spot_log.read.run import Columns, Run, tables_of
from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_file, whole_folder
from spot_model.robot.rotation import rotate_inverse_wxyz

FORMATS: Final = ("parquet", "csv")


class ExportError(BadInputError):
    """A run cannot be exported as asked."""


def export_run(run: Run, directory: Path, file_format: str, topics: Sequence[str] | None = None) -> list[Path]:
    """Write one file a topic, and ``header.json``: the topics asked for, or all that have rows.

    Returns:
        The files written.

    Raises:
        ExportError: Format or topic unknown, or pyarrow is not installed. Nothing is written then.
        OutputExistsError: A file exists. Nothing is written then.
        OSError: A file cannot be written.
    """
    if file_format not in FORMATS:
        raise ExportError(f"format {file_format!r} is not known; allowed: {', '.join((*FORMATS, 'rosbag2'))}")
    tables = tables_of(run)
    for topic in topics or ():
        if topic not in tables:
            raise ExportError(f"topic {topic!r} is not in a log; allowed: {', '.join(tables)}")
    chosen = {name: table for name, table in tables.items() if (name in topics if topics else _n_rows(table))}
    names = [*(f"{name}.{file_format}" for name in chosen), "header.json"]
    check_new(*(directory / name for name in names))
    write = _write_csv if file_format == "csv" else _parquet_writer()
    header = json.dumps(asdict(run.header), indent=2, ensure_ascii=False) + "\n"
    with whole_folder(directory) as part:
        for name, table in chosen.items():
            write(table, part / f"{name}.{file_format}")
        (part / "header.json").write_text(header, encoding="utf-8")
    return [directory / name for name in names]


def _n_rows(table: Columns) -> int:
    return len(next(iter(table.values())))


def _write_csv(table: Columns, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        # repr of a Python float gives back the same number, so a CSV loses nothing.
        writer.writerows(zip(*(_cells(column) for column in table.values()), strict=True))


def _cells(column: NDArray[Any]) -> list[Any]:
    if column.dtype == bool:
        return [int(value) for value in column.tolist()]
    return list(column.tolist())


def _parquet_writer() -> Any:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise ExportError(
            "format 'parquet' needs pyarrow: pip install 'spot-rl[report]', or use --format csv"
        ) from error

    def write(table: Columns, path: Path) -> None:
        parquet.write_table(pa.table(dict(table)), path, compression="zstd")

    return write


TOPICS: Final = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_commands": "sensor_msgs/msg/JointState",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
    "/rosout": "rcl_interfaces/msg/Log",
}
_LEVELS: Final = {Severity.INFO: 20, Severity.WARNING: 30, Severity.ERROR: 40}


def write_rosbag2(run: Run, directory: Path) -> Path:
    """Write the bag of a run to a new folder, its states in full; stamps are the host's clock.

    Raises:
        OutputExistsError: The folder exists.
        ExportError: ``rosbags`` is not installed.
        OSError: It cannot be written.
    """
    check_new(directory)
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ExportError("a ROS 2 bag needs rosbags: pip install 'spot-rl[ros]'") from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    with whole_file(directory) as part, Writer(part, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in TOPICS.items()}
        for stamp_ns, topic, fields in sorted(_messages(run), key=lambda m: m[0]):
            message = _message(store, TOPICS[topic], fields)
            writer.write(connections[topic], stamp_ns, store.serialize_cdr(message, TOPICS[topic]))
    return directory


def _message(store: Any, kind: str, fields: Any) -> Any:
    """A message of a kind from its fields, those of messages within as mappings."""
    if not isinstance(fields, dict):
        return fields
    made = {}
    for name, (_, of) in store.fielddefs[kind][1]:
        value = fields[name]
        made[name] = (
            [_message(store, of[0][1], v) for v in value] if isinstance(value, list) else _message(store, of, value)
        )
    return store.types[kind](**made)


def _messages(run: Run) -> Iterator[tuple[int, str, dict[str, Any]]]:
    states, names = run.states, list(run.header.joint_names)
    linear = rotate_inverse_wxyz(states.odom_from_body_wxyz, states.linear_vel_of_body_in_odom_m_s)
    angular = rotate_inverse_wxyz(states.odom_from_body_wxyz, states.angular_vel_of_body_in_odom_rad_s)
    unknown = np.zeros(36)
    for i, stamp_ns in enumerate(states.host_stamp_ns.tolist()):
        joints = (states.position_rad[i], states.velocity_rad_s[i], states.load_nm[i])
        yield stamp_ns, "/joint_states", _joint_state(stamp_ns, names, *joints)
        place, turn = states.position_of_body_in_odom_m[i], states.odom_from_body_wxyz[i]
        if np.isfinite(place).all() and np.isfinite(turn).all():
            about = {"header": _header(stamp_ns, "odom"), "child_frame_id": "body"}
            at, rotation = _vector(place), dict(zip("wxyz", turn.tolist(), strict=True))
            pose = {"pose": {"position": at, "orientation": rotation}, "covariance": unknown}
            twist = {"twist": _twist(linear[i], angular[i]), "covariance": unknown}  # in the body frame
            yield stamp_ns, "/odom", {**about, "pose": pose, "twist": twist}
            moved = {**about, "transform": {"translation": at, "rotation": rotation}}
            yield stamp_ns, "/tf", {"transforms": [moved]}
    commands = run.commands
    for i, stamp_ns in enumerate(commands.host_stamp_ns.tolist()):
        joints = (commands.position_rad[i], commands.velocity_rad_s[i], commands.load_nm[i])
        yield stamp_ns, "/joint_commands", _joint_state(stamp_ns, names, *joints)
    for stamp_ns, velocity in zip(run.ticks.host_stamp_ns.tolist(), run.ticks.velocity_command, strict=True):
        if np.isfinite(velocity).all():
            twist = _twist((velocity[0], velocity[1], 0.0), (0.0, 0.0, velocity[2]))
            yield stamp_ns, "/cmd_vel", {"header": _header(stamp_ns, "body"), "twist": twist}
    for event in run.events:
        told = {"level": _LEVELS[event.severity], "name": event.name, "msg": event.text}
        place = {"stamp": _time(event.host_stamp_ns), "file": "", "function": "", "line": 0}
        yield event.host_stamp_ns, "/rosout", {**told, **place}


def _time(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}


def _header(stamp_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": _time(stamp_ns), "frame_id": frame}


def _vector(xyz: Any) -> dict[str, float]:
    return {axis: float(v) if math.isfinite(v) else 0.0 for axis, v in zip("xyz", xyz, strict=True)}


def _twist(linear: Any, angular: Any) -> dict[str, Any]:
    return {"linear": _vector(linear), "angular": _vector(angular)}


def _joint_state(stamp_ns: int, names: list[str], position: Any, velocity: Any, load: Any) -> dict[str, Any]:
    """Joints by name; a missing signal is left out, as ROS expects."""
    signals = {"position": _known(position), "velocity": _known(velocity), "effort": _known(load)}
    return {"header": _header(stamp_ns, ""), "name": names, **signals}


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array(values) if np.isfinite(values).all() else np.zeros(0)
