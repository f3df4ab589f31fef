"""Rows from a ROS 2 bag: fields of messages by ``TOPIC.field``, at the messages of one topic.

Each message is flattened: ``/odom.twist.twist.linear`` is an array of three columns, ``/odom.twist.twist.linear.x`` one
of them, and ``/joint_states.position.NAME`` a joint by its name. ``TOPIC.stamp`` is the header's stamp and
``TOPIC.time`` the receipt, both in ns. Between its messages a topic of the state keeps its last value, for ten of its
steps; commands come once a message, at the next row.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_log.importing.mapping import SIGNALS, Mapping
from spot_log.importing.reading import reading
from spot_model.errors import BadInputError

HELD_STEPS: Final = 10
"""A topic is silent after so many of its usual steps."""


class BagTopic(NamedTuple):
    """All messages of one topic."""

    kind: str
    """Such as ``sensor_msgs/msg/JointState``."""
    columns: dict[str, NDArray[Any]]
    """Fields by name, n rows; ``stamp`` where messages have one, and ``time``."""


def is_bag(path: Path) -> bool:
    """Whether it looks like a ROS 2 bag."""
    return path.suffix.lower() in (".mcap", ".db3") or path.is_dir()


def read_rows(path: Path, mapping: Mapping) -> dict[str, NDArray[Any]]:
    """The fields that a mapping names, at the stamps of its time.

    Raises:
        BadInputError: It is no bag, or the time is not a topic's; ``rosbags`` is missing.
        OSError: It cannot be read.
    """
    fields = {name: [s] if isinstance(s := spec.source, str) else s or () for name, spec in mapping.signals.items()}
    topic_of = {name: {field.partition(".")[0] for field in some} for name, some in fields.items()}
    state = set().union(*(some for name, some in topic_of.items() if SIGNALS[name].record == "state"))
    base = (mapping.time.source or "").partition(".")[0]
    topics = read_topics(path, state.union({base}, *topic_of.values()))
    if base not in topics:
        have = ", ".join(f"{name} ({topic.kind})" for name, topic in read_topics(path).items()) or "no topic"
        told = f"{path}: time 'from: {mapping.time.source}' is not TOPIC.stamp or TOPIC.time of a topic"
        raise BadInputError(f"{told}; the bag has {have}; 'spot-rl log import --suggest {path}' writes a mapping")
    arrays: dict[str, NDArray[Any]] = {}
    for topic, (_, columns) in topics.items():
        clock = "stamp" if {"stamp"} <= columns.keys() & topics[base].columns.keys() else "time"
        order = np.argsort(columns[clock], kind="stable")
        stamps, wanted = columns[clock][order], topics[base].columns[clock]
        row = np.searchsorted(stamps, wanted, side="right") - 1
        held_ns = HELD_STEPS * np.median(np.diff(stamps)) if len(stamps) > 1 else np.inf
        is_new = np.diff(row, prepend=-1) > 0
        has = (row >= 0) & (wanted - stamps[np.maximum(row, 0)] <= held_ns) & (is_new | (topic in state))
        for field, values in columns.items():
            held = values
            if topic != base and field not in ("stamp", "time"):
                held = values[order][np.maximum(row, 0)].astype(np.float64)
                held[~has] = np.nan
            arrays[f"{topic}.{field}"] = held
    return arrays


def read_topics(path: Path, wanted: Collection[str] | None = None) -> dict[str, BagTopic]:
    """Topics by name; those of ``wanted``, or all.

    Raises:
        BadInputError: It is no bag, or damaged; ``rosbags`` is missing.
        OSError: It cannot be read.
    """
    if not path.exists():
        raise BadInputError(f"{path} does not exist; give a recording")
    rows: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    hint = "(a log of spot-rl needs no import, and 'mcap recover' repairs an .mcap that was cut)"
    with reading(path, f"a ROS 2 bag {hint}", "'spot-rl[ros]'"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            chosen = [c for c in reader.connections if wanted is None or c.topic in wanted]
            for connection, log_ns, raw in reader.messages(chosen) if chosen else ():
                message = reader.deserialize(raw, connection.msgtype)
                rows[connection.topic, connection.msgtype].append({"time": log_ns, **dict(_fields(message))})
    return {topic: BagTopic(kind, _columns(f"{path}: {topic}", found)) for (topic, kind), found in rows.items()}


def _fields(message: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The numbers of a message, by dotted names."""
    values = {f.name: getattr(message, f.name) for f in dataclasses.fields(message) if f.name != "__msgtype__"}
    if path == "header" and hasattr(values.get("stamp"), "nanosec"):
        yield "stamp", values["stamp"].sec * 10**9 + values["stamp"].nanosec
        return
    names = values.get("name")
    for field, value in values.items():
        name = f"{path}.{field}".lstrip(".")
        if dataclasses.is_dataclass(value):
            yield from _fields(value, name)
        elif isinstance(value, (bool, int, float)):
            yield name, value
        elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiub" and len(value):
            # Joints come by name, and not always in one order.
            if isinstance(names, list) and len(names) == len(value):
                yield from ((f"{name}.{joint}", part) for joint, part in zip(names, value, strict=True))
            else:
                yield name, value
    if path and set(values) in ({"x", "y", "z"}, {"x", "y", "z", "w"}):
        yield path, [values[axis] for axis in "xyzw"[: len(values)]]


def _columns(where: str, rows: list[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        sizes = {np.shape(row[name]) for row in rows if name in row}
        if len(sizes) > 1:
            raise BadInputError(f"{where}.{name} has messages of different lengths: {sorted(sizes)}")
        missing = np.full(sizes.pop(), np.nan)
        columns[name] = np.array([row.get(name, missing) for row in rows])
    if not columns.get("stamp", np.ones(1)).all():
        del columns["stamp"]  # some messages have none
    return columns
