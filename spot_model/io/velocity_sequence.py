"""Velocity-command sequences: what the operator asks for over time, and the paper's four."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import yaml
from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.whole import write_new
from spot_model.io.yaml_text import read_yaml
from spot_model.robot.facts import Array

SCHEMA: Final = "spot-rl/velocity-sequence/1"


class Waypoint(Settings):
    """The command from one instant on."""

    time_s: float = Field(ge=0.0, le=3600.0)
    """When, s; 0 for the first waypoint, then rising."""
    v_x_m_s: float = Field(default=0.0, ge=-10.0, le=10.0)
    """Forward, m/s."""
    v_y_m_s: float = Field(default=0.0, ge=-10.0, le=10.0)
    """To the left, m/s."""
    yaw_rate_rad_s: float = Field(default=0.0, ge=-10.0, le=10.0)
    """Turn to the left, rad/s."""
    ramp: bool = False
    """Whether the command changes linearly from the previous waypoint, instead of in a step."""

    @property
    def command(self) -> tuple[float, float, float]:
        """V_x, V_y (m/s), ω_z (rad/s)."""
        return (self.v_x_m_s, self.v_y_m_s, self.yaw_rate_rad_s)


class Commands(NamedTuple):
    """The waypoints of a sequence as plain numbers.

    Reading the models instead costs a control tick, whose caches are cold, about 20 µs.
    """

    times_s: Sequence[float]
    commands: Sequence[tuple[float, float, float]]
    """V_x, V_y (m/s), ω_z (rad/s)."""
    ramps: Sequence[bool]

    def at(self, time_s: float) -> Array:
        """The command at a time, shape (3,): V_x, V_y (m/s), ω_z (rad/s); the last one holds after the end."""
        times_s, commands, ramps = self
        index = max(0, bisect_right(times_s, time_s) - 1)
        if index + 1 == len(times_s) or not ramps[index + 1]:
            return np.array(commands[index])
        share = (time_s - times_s[index]) / (times_s[index + 1] - times_s[index])
        return np.array([a + share * (b - a) for a, b in zip(commands[index], commands[index + 1], strict=True)])


class VelocitySequence(Settings):
    """A named sequence of velocity commands over ``duration_s``."""

    schema_name: Literal["spot-rl/velocity-sequence/1"] = Field(default=SCHEMA, alias="schema")
    name: str = Field(min_length=1, max_length=100)
    """Name of the sequence, for the log."""
    duration_s: float = Field(gt=0.0, le=3600.0)
    """Its length, s."""
    waypoints: tuple[Waypoint, ...] = Field(min_length=1, max_length=100_000)
    """The commands, below."""

    def model_post_init(self, _context: object) -> None:
        """Check that waypoint times rise from 0 within the duration."""
        times = [w.time_s for w in self.waypoints]
        if times[0] != 0.0 or any(b <= a for a, b in pairwise(times)):
            raise ValueError("waypoints: time_s must start at 0 and rise")
        if times[-1] > self.duration_s:
            raise ValueError(f"waypoints: time_s = {times[-1]} lies after duration_s = {self.duration_s}")

    @property
    def commands(self) -> Commands:
        """The waypoints as plain numbers."""
        points = self.waypoints
        return Commands([w.time_s for w in points], [w.command for w in points], [w.ramp for w in points])

    def at(self, time_s: float) -> Array:
        """The command at a time, shape (3,): V_x, V_y (m/s), ω_z (rad/s). For many times use :attr:`commands`."""
        return self.commands.at(time_s)

    def sampled(self, rate_hz: float) -> Array:
        """All commands at a fixed rate, shape (duration · rate, 3)."""
        count, commands = round(self.duration_s * rate_hz), self.commands
        return np.array([commands.at(i / rate_hz) for i in range(count)])

    def clipped(self, low: Array, high: Array) -> VelocitySequence:
        """The same sequence within a policy's command range, each shape (3,)."""

        def clip(w: Waypoint) -> Waypoint:
            v_x, v_y, yaw = (float(v) for v in np.clip(w.command, low, high))
            return Waypoint(time_s=w.time_s, v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw, ramp=w.ramp)

        return self.model_copy(update={"waypoints": tuple(clip(w) for w in self.waypoints)})


def sequence_of(name: str, duration_s: float, *points: Sequence[float], is_ramped: bool = False) -> VelocitySequence:
    """A sequence of points: time (s), V_x, V_y (m/s), ω_z (rad/s), ramp; a point may leave out those at its end.

    With ``is_ramped``, each but the first is reached in a straight line unless it says otherwise.
    """
    fields = ("time_s", "v_x_m_s", "v_y_m_s", "yaw_rate_rad_s", "ramp")
    told = [{"ramp": is_ramped and i > 0, **dict(zip(fields, point, strict=False))} for i, point in enumerate(points)]
    waypoints = tuple(Waypoint.model_validate(values) for values in told)
    return VelocitySequence(name=name, duration_s=duration_s, waypoints=waypoints)


def forward_sequence(top_speed_m_s: float = 4.0) -> VelocitySequence:
    """Run forward: from a standstill at rising speed to the top, hold, and back to a stop. Source: the paper."""
    top = (top_speed_m_s, 0.0, 0.0, True)
    return sequence_of("forward", 20.0, (0.0,), (1.0,), (11.0, *top), (16.0, *top), (18.5, 0.0, 0.0, 0.0, True))


def six_directions_sequence() -> VelocitySequence:
    """Forward, back, left, right (m/s), turn left, turn right (rad/s) at moderate speed. Source: the paper."""
    directions = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
    points = [(1.0 + 3.0 * i, 1.5 * x, 1.5 * y, 1.5 * yaw) for i, (x, y, yaw) in enumerate(directions)]
    return sequence_of("six_directions", 20.0, (0.0,), *points, (19.0,))


def random_sequence(seed: int = 0) -> VelocitySequence:
    """Commands drawn evenly within bounds, a new one every 2 s. Source: the paper's randomly changing commands."""
    rng = np.random.default_rng(seed)
    points = [(1.0 + 2.0 * i, *rng.uniform((-1.5, -1.0, -1.5), (3.0, 1.0, 1.5)).tolist()) for i in range(9)]
    return sequence_of("random", 20.0, (0.0,), *points, (19.0,))


def standing_sequence(duration_s: float = 20.0) -> VelocitySequence:
    """Stand still."""
    return sequence_of("standing", duration_s, (0.0,))


BUILT_IN: Final[dict[str, Callable[[], VelocitySequence]]] = {
    "forward": forward_sequence,
    "six_directions": six_directions_sequence,
    "random": random_sequence,
    "standing": standing_sequence,
}


def load_sequence(name_or_path: str) -> VelocitySequence:
    """A built-in sequence by name, or one from a YAML file.

    Raises:
        BadInputError: Neither a built-in name nor a readable, valid file; the message names key, value and bounds.
    """
    if name_or_path in BUILT_IN:
        return BUILT_IN[name_or_path]()
    path = Path(name_or_path)
    if not _is_file(path):
        raise BadInputError(
            f"velocity sequence {name_or_path!r} is not a file; allowed: a YAML file, or one of {', '.join(BUILT_IN)}"
        )
    data = read_yaml(path, "velocity sequence")
    try:
        # By way of JSON, pydantic's strict mode takes a list for a tuple, but neither "3" nor true for 3.
        return VelocitySequence.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise BadInputError(f"velocity sequence {path}:\n{explain(error, VelocitySequence)}") from error


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # no name that a file can have
        return False


def save_sequence(sequence: VelocitySequence, path: Path) -> None:
    """Write a sequence as YAML; refuses to overwrite. Raises OutputExistsError: the file exists."""
    write_new(path, yaml.safe_dump(sequence.model_dump(by_alias=True, mode="json"), sort_keys=False))
