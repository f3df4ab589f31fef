"""A mapping to start from: what names, sizes and message types of a recording suggest."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.importing.bag import BagTopic, is_bag, read_topics
from spot_log.importing.lerobot import entry_names, is_lerobot, read_episode, read_info
from spot_log.importing.mapping import SCHEMA
from spot_log.importing.recording import UNITS, read_arrays
from spot_model.robot.arm import ARM_JOINT_NAMES
from spot_model.robot.facts import JOINT_NAMES

_KINDS: Final = {
    "position": ("rad", r"q|pos|positions?|angles?"),
    "velocity": ("rad/s", r"qd|dq|vel|velocity|velocities|speed"),
    "load": ("N·m", r"tau|torques?|effort|load"),
}
"""Unit and words of what a joint has; then words of what was asked of it, of stamps, of the rest, and beside names."""
_WANTED: Final = r"set|setpoint|des|desired|cmd|commands?|target|ref|goal"
_TIMES: Final = r"t|time|stamp|timestamp|clock"
_OTHERS: Final = rf"{_TIMES}|body|base|odom|imu|foot|feet|key"
_FILLERS: Final = "|".join((r"dof|joints?|motor|rad|deg|s|nm|m", *(words for _, words in _KINDS.values())))
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
    if is_lerobot(path):
        lines = _of_lerobot(path)
    else:
        lines = _of_bag(read_topics(path)) if is_bag(path) else _of_arrays(read_arrays(path))
    about = f"# A guess from the names in {path.name}: check every unit, order and frame."
    return "\n".join([about, f"schema: {SCHEMA}", *lines]) + "\n"


def _of_lerobot(path: Path) -> Iterator[str]:
    """The state's motors as joints; actions of the same motors as what was asked of them."""
    features, arrays = read_info(path).features, read_episode(path, 0)
    state = arrays.get("observation.state", np.zeros((1, 0)))
    motors = list(entry_names(features["observation.state"].names)) if state.size else []
    ends = ".pos" if motors and all(name.endswith(".pos") for name in motors) else ""
    is_named = len(motors) == state.shape[1]
    unit = "rad" if np.nanmax(np.abs(state), initial=0.0) <= 7 else "deg"
    yield from _names(
        [name.removesuffix(ends) for name in motors] if is_named else [f"joint_{i}" for i in range(state.shape[1])]
    )
    yield from ("time: {from: timestamp, unit: s}", "signals:")
    for signal, feature in (("position", "observation.state"), ("setpoint_position", "action")):
        if arrays.get(feature, state[:0]).shape == state.shape:
            source = f"{feature}.{{joint}}{ends}" if is_named and f"{feature}.{motors[0]}" in arrays else feature
            yield f'  {signal}: {{from: "{source}", unit: {unit}}}'
    if unit == "deg":
        yield "# Degrees, or -100 to 100 for a motor's range (then give 'scale'): the data set does not say which."
    yield f"# An episode has: {', '.join(arrays)}"[:300]


def _of_bag(topics: dict[str, BagTopic]) -> Iterator[str]:
    kinds = {name: topic.kind.rpartition("/")[2].removesuffix("Stamped") for name, topic in topics.items()}
    first = {"wanted" if kind == "JointState" and _has(name, _WANTED) else kind: name for name, kind in kinds.items()}
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
        is_wanted = _has(name, _WANTED)
        kind = next((kind for kind, (_, known) in _KINDS.items() if _has(name, known)), "position" * is_wanted)
        if kind and array.dtype.kind in "fiu" and not _has(name, _OTHERS):
            signal = {"load": "feedforward"}.get(kind, f"setpoint_{kind}") if is_wanted else kind
            signals.setdefault(signal, []).append(name)
    sizes = {s: sum(arrays[n][:1].size for n in columns) for s, columns in signals.items()}
    found, size = signals["position"], sizes["position"]
    named = ["_".join(word for word in _words(name) if not re.fullmatch(_FILLERS, word)) for name in found]
    spots = {len(names): names for names in (JOINT_NAMES, (*JOINT_NAMES, *ARM_JOINT_NAMES))}
    usual = spots.get(size) or [f"joint_{i}" for i in range(size)]
    yield from _names(named if len(set(named)) == size and all(named) else usual)
    stamps = next((name for name in arrays if _has(name, _TIMES)), "")
    yield _time(stamps, arrays[stamps]) if stamps else "time: {rate_hz: RATE}  # no array is named as stamps are"
    yield "signals:"
    largest = max((float(np.nanmax(np.abs(arrays[name]), initial=0.0)) for name in found), default=0.0)
    for signal, columns in signals.items():
        unit = next((unit for kind, (unit, _) in _KINDS.items() if kind in signal), "N·m")
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
        # What is more, such as an arm's, is left out.
        yield from [f"source_joint_names: {_listed(list(ours.values()))}"] if len(ours) > len(JOINT_NAMES) else []
    else:
        yield from [f"joint_names: {_listed(joints)}", "foot_names: []"]


def _time(name: str, stamps: NDArray[Any]) -> str:
    """The time's unit by its name, or the first that makes a usual rate of the steps; dates are those since 2001."""
    rate = 1 / float(np.median(np.diff(stamps))) if len(stamps) > 1 else 1.0
    said = [word for word in _words(name) if word in UNITS["time"]]
    unit = next((u for u in (*said, "s", "ms", "us", "ns") if u in said or 2 < rate / UNITS["time"][u] < 5000), "s")
    clock = ", clock: unix" if stamps[0] * UNITS["time"][unit] > 1e9 else ""
    return f"time: {{from: {_listed([name])[1:-1]}, unit: {unit}{clock}}}"


def _listed(names: Sequence[str]) -> str:
    """Names as a list of YAML; quoted where they would be something else."""
    plain = re.compile(r"[A-Za-z_][\w.]*")
    return f"[{', '.join(name if plain.fullmatch(name) else json.dumps(name) for name in names) or 'NAME'}]"


def _words(name: str) -> list[str]:
    return re.findall(r"[a-z]+|\d+", name.lower())


def _has(name: str, words: str) -> bool:
    return any(re.fullmatch(words, word) for word in _words(name))
