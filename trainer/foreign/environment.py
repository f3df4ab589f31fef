"""An environment's configuration as Isaac Lab dumps it, YAML or JSON, as plain data; and the parts that others share.

Tags of Python objects are read as the plain lists, mappings and texts under them: nothing is constructed.
"""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from spot_model.errors import BadInputError
from spot_model.io.bounded_file import FileTooLargeError, read_at_most
from trainer.foreign.description import by_joint, mapping, matching, number

MAX_BYTES: Final = 4 * 1024 * 1024
DEFAULT_COMMANDS: Final = ((-1.0, -0.5, -1.0), (1.0, 0.5, 1.0))
"""Range of velocity commands where no file names one: V_x, V_y (m/s), ω_z (rad/s)."""
Ranges = tuple[tuple[float, float, float], tuple[float, float, float]]


class _PlainLoader(yaml.SafeLoader):
    """Reads every tag of Python as the plain value under it."""


def _plain(loader: yaml.SafeLoader, _suffix: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)  # type: ignore[arg-type]


_PlainLoader.add_multi_constructor("tag:yaml.org,2002:python/", _plain)


def read_environment(path: Path) -> dict[str, Any]:
    """The environment's configuration as plain data.

    Raises:
        BadInputError: The file cannot be read, or is not a mapping.
    """
    try:
        text = read_at_most(path, MAX_BYTES).decode("utf-8")
        data = json.loads(text) if path.suffix == ".json" else yaml.load(text, Loader=_PlainLoader)  # noqa: S506 - see it
    except RecursionError as error:
        raise BadInputError(f"environment file {path} is nested too deep; give the training run's env.yaml") from error
    except (OSError, FileTooLargeError, UnicodeDecodeError, ValueError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInputError(
            f"environment file {path} cannot be read: {reason}; give the training run's env.yaml, or its JSON"
        ) from error
    if not isinstance(data, dict):
        raise BadInputError(f"environment file {path} holds no mapping; give the env.yaml of the training run")
    return data


def read_agent(environment: Path) -> dict[str, Any]:
    """The learner's configuration, which Isaac Lab and mjlab write beside the environment's; empty without one.

    Raises:
        BadInputError: It cannot be read.
    """
    path = environment.with_name("agent.yaml")
    return read_environment(path) if path.is_file() else {}


def action_clip(agent: Mapping[str, Any]) -> float:
    """What the learner's wrapper clips actions to, plus and minus; infinity where it does not."""
    clip = agent.get("clip_actions")
    if clip is None:
        return math.inf
    found = number(clip, "agent.yaml: clip_actions")
    if found <= 0.0:
        raise BadInputError(f"agent.yaml: clip_actions = {found:g}; it must be above 0, or null")
    return found


def rate_of(environment: Mapping[str, Any]) -> float:
    """Rate of the policy, Hz: one action in ``decimation`` physics steps of ``sim.dt``."""
    step_s = number(get(environment, "sim.dt"), "sim.dt") * number(get(environment, "decimation"), "decimation")
    if step_s <= 0.0:
        raise BadInputError(f"sim.dt · decimation = {step_s:g} s; it must be above 0")
    return 1.0 / step_s


def gains_of(environment: Mapping[str, Any], key: str, joints: tuple[str, ...]) -> tuple[float, ...]:
    """``stiffness`` or ``damping`` of each joint, from the groups of actuators.

    Raises:
        BadInputError: A joint has none; the message names it.
    """
    found: dict[str, float] = {}
    where = "scene.robot.actuators"
    for name, given in mapping(get(environment, where), where).items():
        group, here = mapping(given, f"{where}.{name}"), f"{where}.{name}"
        of_each = matching(group.get("joint_names_expr") or [".*"], joints, f"{here}.joint_names_expr")
        named = [joint for joint in joints if any(joint in own for own in of_each)]
        if group.get(key) is None:
            raise BadInputError(f"{here}.{key} is not in the file; give numbers there")
        found |= dict(zip(named, by_joint(group[key], named, f"{here}.{key}"), strict=True))
    missing = [joint for joint in joints if joint not in found]
    if missing:
        raise BadInputError(f"{where} has no {key} of {', '.join(missing)}")
    return tuple(found[joint] for joint in joints)


def command_ranges(environment: Mapping[str, Any]) -> tuple[Ranges, tuple[str, ...]]:
    """Least and largest velocity command, and what was assumed where no command names a range."""
    commands = mapping(environment.get("commands"), "commands")
    found = ((name, c["ranges"]) for name, c in commands.items() if isinstance(c, Mapping) and c.get("ranges"))
    name, ranges = next(found, ("", None))
    if ranges is None:
        return DEFAULT_COMMANDS, ("velocity commands within ±1 m/s, ±0.5 m/s, ±1 rad/s: no file names a range",)
    where = f"commands.{name}.ranges"
    pairs = [
        pair(get(mapping(ranges, where), key), f"{where}.{key}") for key in ("lin_vel_x", "lin_vel_y", "ang_vel_z")
    ]
    (a, b), (c, d), (e, f) = pairs
    return ((a, c, e), (b, d, f)), ()


def pair(value: Any, source: str) -> tuple[float, float]:
    """Two numbers of a file, low and high. Raises ``BadInputError`` where there are others."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise BadInputError(f"{source} = {reprlib.repr(value)}; it must be two numbers, low and high")
    low, high = (number(v, source) for v in value)
    return low, high


def get(data: Mapping[str, Any], dotted: str) -> Any:
    """A value by its path. Raises ``BadInputError`` with the path where it is not there."""
    value: Any = data
    for key in dotted.split("."):
        if not isinstance(value, Mapping) or key not in value:
            raise BadInputError(f"the environment file has no {dotted}; give the env.yaml of the training run")
        value = value[key]
    return value
