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
from spot_log.read.run import Run, Table, tables_of
from spot_model.errors import BadInputError
from spot_model.io.whole import check_new, whole_file, whole_folder
from spot_model.robot.rotation import rotate_inverse_wxyz

FORMATS: Final = ("parquet", "csv")


class ExportError(BadInputError):
    """A run cannot be exported as asked."""


def export_run(run: Run, directory: Path, file_format: str, topics: Sequence[str] | None = None) -> list[Path]:
    """Write one file a topic, and ``header.json``.

    Args:
        run: What to export.
        directory: Where to; made if need be.
        file_format: ``parquet`` (needs pyarrow) or ``csv``.
        topics: Which tables; all that have rows by default.

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


def _n_rows(table: Table) -> int:
    return len(next(iter(table.values())))


def _write_csv(table: Table, path: Path) -> None:
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

    def write(table: Table, path: Path) -> None:
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


class RosExportError(BadInputError):
    """A run cannot be written as a ROS 2 bag."""


def write_rosbag2(run: Run, directory: Path) -> Path:
    """Write the bag; stamps are the host's clock.

    Args:
        run: What to write; its states in full, 333 a second on Spot.
        directory: The bag's folder, which must not exist.

    Raises:
        OutputExistsError: The folder exists.
        RosExportError: ``rosbags`` is not installed.
        OSError: It cannot be written.
    """
    check_new(directory)
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RosExportError("a ROS 2 bag needs rosbags: pip install 'spot-rl[ros]'") from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    with whole_file(directory) as part, Writer(part, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in TOPICS.items()}
        for stamp_ns, topic, message in sorted(_messages(run, store.types), key=lambda m: m[0]):
            writer.write(connections[topic], stamp_ns, store.serialize_cdr(message, TOPICS[topic]))
    return directory


def _messages(run: Run, types: Any) -> Iterator[tuple[int, str, Any]]:
    make = _Maker(types)
    states, names = run.states, list(run.header.joint_names)
    linear = rotate_inverse_wxyz(states.odom_from_body_wxyz, states.linear_vel_of_body_in_odom_m_s)
    angular = rotate_inverse_wxyz(states.odom_from_body_wxyz, states.angular_vel_of_body_in_odom_rad_s)
    for i, stamp_ns in enumerate(states.host_stamp_ns.tolist()):
        joints = (states.position_rad[i], states.velocity_rad_s[i], states.load_nm[i])
        yield stamp_ns, "/joint_states", make.joint_state(stamp_ns, names, *joints)
        place, turn = states.position_of_body_in_odom_m[i], states.odom_from_body_wxyz[i]
        if np.isfinite(place).all() and np.isfinite(turn).all():
            yield stamp_ns, "/odom", make.odometry(stamp_ns, place, turn, linear[i], angular[i])
            yield stamp_ns, "/tf", make.transform(stamp_ns, place, turn)
    commands = run.commands
    for i, stamp_ns in enumerate(commands.host_stamp_ns.tolist()):
        joints = (commands.position_rad[i], commands.velocity_rad_s[i], commands.load_nm[i])
        yield stamp_ns, "/joint_commands", make.joint_state(stamp_ns, names, *joints)
    for stamp_ns, velocity in zip(run.ticks.host_stamp_ns.tolist(), run.ticks.velocity_command, strict=True):
        if np.isfinite(velocity).all():
            yield stamp_ns, "/cmd_vel", make.command(stamp_ns, velocity)
    for event in run.events:
        yield event.host_stamp_ns, "/rosout", make.log(event.host_stamp_ns, event.severity, event.name, event.text)


class _Maker:
    """ROS 2 messages from numbers."""

    def __init__(self, types: Any) -> None:
        self._types = types

    def _new(self, kind: str, **fields: Any) -> Any:
        package, _, name = kind.partition("/")
        return self._types[f"{package}/msg/{name}"](**fields)

    def _header(self, stamp_ns: int, frame: str) -> Any:
        return self._new("std_msgs/Header", stamp=self._time(stamp_ns), frame_id=frame)

    def _time(self, stamp_ns: int) -> Any:
        return self._new("builtin_interfaces/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)

    def _vector(self, xyz: Any, kind: str = "Vector3") -> Any:
        x, y, z = (float(v) if math.isfinite(v) else 0.0 for v in xyz)
        return self._new(f"geometry_msgs/{kind}", x=x, y=y, z=z)

    def _rotation(self, wxyz: Any) -> Any:
        w, x, y, z = map(float, wxyz)
        return self._new("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def _twist(self, linear: Any, angular: Any) -> Any:
        return self._new("geometry_msgs/Twist", linear=self._vector(linear), angular=self._vector(angular))

    def joint_state(self, stamp_ns: int, names: list[str], position: Any, velocity: Any, load: Any) -> Any:
        """Joints by name; a missing signal is left out, as ROS expects."""
        return self._new(
            "sensor_msgs/JointState",
            header=self._header(stamp_ns, ""),
            name=names,
            position=_known(position),
            velocity=_known(velocity),
            effort=_known(load),
        )

    def odometry(self, stamp_ns: int, place: Any, turn: Any, linear: Any, angular: Any) -> Any:
        """The body in odom; velocities in the body frame."""
        pose = self._new("geometry_msgs/Pose", position=self._vector(place, "Point"), orientation=self._rotation(turn))
        unknown = np.zeros(36)
        return self._new(
            "nav_msgs/Odometry",
            header=self._header(stamp_ns, "odom"),
            child_frame_id="body",
            pose=self._new("geometry_msgs/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=self._new(
                "geometry_msgs/TwistWithCovariance", twist=self._twist(linear, angular), covariance=unknown
            ),
        )

    def transform(self, stamp_ns: int, place: Any, turn: Any) -> Any:
        """The body's frame in odom."""
        moved = self._new("geometry_msgs/Transform", translation=self._vector(place), rotation=self._rotation(turn))
        stamped = self._new(
            "geometry_msgs/TransformStamped",
            header=self._header(stamp_ns, "odom"),
            child_frame_id="body",
            transform=moved,
        )
        return self._new("tf2_msgs/TFMessage", transforms=[stamped])

    def command(self, stamp_ns: int, velocity: Any) -> Any:
        """A velocity command."""
        twist = self._twist((velocity[0], velocity[1], 0.0), (0.0, 0.0, velocity[2]))
        return self._new("geometry_msgs/TwistStamped", header=self._header(stamp_ns, "body"), twist=twist)

    def log(self, stamp_ns: int, severity: Severity, name: str, text: str) -> Any:
        """An event as a line of the log."""
        return self._new(
            "rcl_interfaces/Log",
            stamp=self._time(stamp_ns),
            level=_LEVELS[severity],
            name=name,
            msg=text,
            file="",
            function="",
            line=0,
        )


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array(values) if np.isfinite(values).all() else np.zeros(0)
