"""A mapping to start from: what names, sizes and message types of a recording suggest."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.importing.bag import Topic, is_bag, read_topics
from spot_log.importing.mapping import SCHEMA
from spot_log.importing.recording import UNITS, read_arrays
from spot_model.robot.facts import JOINT_NAMES

_WORDS: Final = {
    "position": ("rad", {"q", "pos", "position", "positions", "angle", "angles"}),
    "velocity": ("rad/s", {"qd", "dq", "vel", "velocity", "velocities", "speed"}),
    "load": ("N·m", {"tau", "torque", "torques", "effort", "load"}),
}
_WANTED: Final = {"set", "setpoint", "des", "desired", "cmd", "command", "commands", "target", "ref", "goal"}
_TIMES: Final = {"t", "time", "stamp", "timestamp", "clock"}
_BODY: Final = {"body", "base", "odom", "imu", "foot", "feet", "key"}
_FILLERS: Final = {"dof", "joint", "joints", "motor", "rad", "deg", "s", "nm", "m"}.union(
    *(words for _, words in _WORDS.values())
)
_FIELDS: Final = """
JointState position position.{joint} unit: rad
JointState velocity velocity.{joint} unit: rad/s
JointState load effort.{joint} unit: N·m
wanted setpoint_position position.{joint} unit: rad
wanted setpoint_velocity velocity.{joint} unit: rad/s
wanted feedforward effort.{joint} unit: N·m
Odometry position_of_body_in_odom pose.pose.position unit: m
Odometry odom_from_body pose.pose.orientation order: xyzw
Odometry linear_vel_of_body_in_body twist.twist.linear unit: m/s
Odometry angular_vel_of_body_in_body twist.twist.angular unit: rad/s
Imu acceleration_of_imu_in_link linear_acceleration unit: m/s^2
Imu angular_vel_of_link_in_link angular_velocity unit: rad/s"""
_SPOT: Final = "front.left=fl front.right=fr rear.left=hl rear.right=hr hind.left=hl hind.right=hr hip.=h knee=kn"


def suggest(path: Path) -> str:
    """The text of a mapping. Raises BadInputError, OSError where the recording cannot be read."""
    lines = _of_bag(read_topics(path)) if is_bag(path) else _of_arrays(read_arrays(path))
    about = f"# A guess from the names in {path.name}: check every unit, order and frame."
    return "\n".join([about, f"schema: {SCHEMA}", *lines]) + "\n"


def _of_bag(topics: dict[str, Topic]) -> Iterator[str]:
    kinds = {name: topic.kind.rpartition("/")[2].removesuffix("Stamped") for name, topic in topics.items()}
    first = {"wanted" if kind == "JointState" and _is_wanted(name) else kind: name for name, kind in kinds.items()}
    base = first.get("JointState", next(iter(topics), "TOPIC"))
    columns = topics[base].columns if topics else {}
    yield from _names([field.partition(".")[2] for field in columns if field.startswith("position.")])
    yield f"time: {{from: {base}.{'stamp' if 'stamp' in columns else 'time'}, unit: ns, clock: unix}}"
    yield "signals:"
    for kind, signal, field, unit in (line.split(maxsplit=3) for line in _FIELDS.split("\n")[1:]):
        if kind in first and any(
            name.startswith(field.removesuffix("{joint}")) for name in topics[first[kind]].columns
        ):
            yield f'  {signal}: {{from: "{first[kind]}.{field}", {unit}}}'
    if "Twist" in first:
        start = first["Twist"] + ".twist" * topics[first["Twist"]].kind.endswith("Stamped")
        yield f"  velocity_command: {{from: [{start}.linear.x, {start}.linear.y, {start}.angular.z]}}"
    yield from (f"# {name} ({topic.kind}): {', '.join(topic.columns)}"[:300] for name, topic in topics.items())


def _of_arrays(arrays: dict[str, NDArray[Any]]) -> Iterator[str]:
    signals: dict[str, list[str]] = {"position": []}
    for name, array in arrays.items():
        words = set(_words(name))
        kind = next((kind for kind, (_, known) in _WORDS.items() if words & known), "position" * _is_wanted(name))
        if kind and array.dtype.kind in "fiu" and not words & (_TIMES | _BODY):
            signals.setdefault(_signal(name, kind), []).append(name)
    sizes = {s: sum(arrays[n][:1].size for n in columns) for s, columns in signals.items()}
    found, size = signals["position"], sizes["position"]
    named = ["_".join(word for word in _words(name) if word not in _FILLERS) for name in found]
    usual = JOINT_NAMES if size == len(JOINT_NAMES) else [f"joint_{i}" for i in range(size)]
    yield from _names(named if len(set(named)) == size and all(named) else usual)
    stamps = next((name for name in arrays if _TIMES & set(_words(name))), "")
    yield _time(stamps, arrays[stamps]) if stamps else "time: {rate_hz: RATE}  # no array is named as stamps are"
    yield "signals:"
    largest = max((float(np.nanmax(np.abs(arrays[name]), initial=0.0)) for name in found), default=0.0)
    for signal, columns in signals.items():
        unit = next((unit for kind, (unit, _) in _WORDS.items() if kind in signal), "N·m")
        source = _listed(columns) if len(columns) == size else _listed(columns)[1:-1]
        if sizes[signal] == size:
            yield f"  {signal}: {{from: {source}, unit: {unit.replace('rad', 'deg') if largest > 7 else unit}}}"
    yield f"# The file has: {', '.join(arrays)}"[:300]


def _names(joints: Sequence[str]) -> Iterator[str]:
    """Joint names; Spot's are ours, and what the source calls them."""
    ours = {joint: joint.lower() for joint in joints}
    for word, short in (pair.split("=") for pair in _SPOT.split()):
        ours = {joint: re.sub(word, short, text).replace(".", "_") for joint, text in ours.items()}
    if set(ours.values()) >= set(JOINT_NAMES):
        other = [f"{text}: {joint}" for joint, text in ours.items() if text in JOINT_NAMES and text != joint]
        yield from [f"names_in_source: {{{', '.join(other)}}}"] if other else []
    else:
        yield from [f"joint_names: {_listed(joints)}", "foot_names: []"]


def _time(name: str, stamps: NDArray[Any]) -> str:
    """The time's unit by its name, or by the size of dates and steps."""
    first, step = float(stamps[0]), float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    said = next((word for word in _words(name) if word in UNITS["time"]), "")
    dated = next((unit for unit, least in (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8)) if first > least), "")
    stepped = next((unit for unit, least in (("ns", 1e5), ("us", 500), ("ms", 0.6)) if step > least), "s")
    return f"time: {{from: {_listed([name])[1:-1]}, unit: {said or dated or stepped}{', clock: unix' * bool(dated)}}}"


def _listed(names: Sequence[str]) -> str:
    """Names as a list of YAML; quoted where they would be something else."""
    plain = re.compile(r"[A-Za-z_][\w.]*")
    return f"[{', '.join(name if plain.fullmatch(name) else json.dumps(name) for name in names) or 'NAME'}]"


def _words(name: str) -> list[str]:
    return re.findall(r"[a-z]+|\d+", name.lower())


def _is_wanted(name: str) -> bool:
    return bool(_WANTED & set(_words(name)))


def _signal(name: str, kind: str) -> str:
    """The signal of that kind, or what was asked of it."""
    return {"load": "feedforward"}.get(kind, f"setpoint_{kind}") if _is_wanted(name) else kind
