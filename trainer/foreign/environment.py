"""An environment's configuration as Isaac Lab dumps it, YAML or JSON, and the parts that the vendor's example shares.

Tags of Python objects are read as the plain lists, mappings and texts under them: nothing is constructed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import yaml
from pydantic import AliasPath, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import explain
from spot_model.io.yaml_text import FileTooLargeError, read_at_most
from trainer.foreign.description import DEFAULT_COMMANDS, MAX_HISTORY

MAX_BYTES: Final = 4 * 1024 * 1024
Bounds = tuple[float, float, float]


def _no_flag(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError("it must be a number")
    return value


def _listed(value: Any) -> Any:
    """Regular expressions as a list; all names where there are none."""
    return [value] if value and isinstance(value, str) else value or [".*"]


YamlNumber = Annotated[float, BeforeValidator(_no_flag)]
"""A number, or a text that is one (YAML reads 1e-3 as a text)."""
ByJoint = YamlNumber | dict[re.Pattern[str], YamlNumber]
"""One value for all joints, or values by regular expressions that match whole names."""
Names = Annotated[tuple[re.Pattern[str], ...], BeforeValidator(_listed)]
ALL: Final = (re.compile(".*"),)


class FilePart(BaseModel):
    """A part of a file of another framework, of which we read some keys."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


class Joints(FilePart):
    """Which joints a term or an action means, and whether in the order of the expressions or in the robot's."""

    joint_names: Names = ALL
    preserve_order: bool = False


class ObservationTerm(FilePart):
    """One term of a group of observations."""

    func: str = ""
    asset: Joints | None = Field(default=None, validation_alias=AliasPath("params", "asset_cfg"))
    scale: YamlNumber | tuple[YamlNumber, ...] | None = None
    clip: tuple[YamlNumber, YamlNumber] | None = None
    flatten_history_dim: Any = None
    history_length: Annotated[int, Field(ge=0, le=MAX_HISTORY)] | None = None
    modifiers: Any = None
    command_name: str | None = Field(default=None, validation_alias=AliasPath("params", "command_name"))


class ObservationGroup(FilePart):
    """Terms by name, one after the other; ``None`` for one that is left out."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ObservationTerm | None] = Field(init=False)
    concatenate_terms: bool = True
    concatenate_dim: Any = None
    enable_corruption: Any = None
    flatten_history_dim: Any = None
    history_length: Annotated[int, Field(ge=0, le=MAX_HISTORY)] | None = None
    history_layout: Literal["terms", "frames"] | None = None
    """Ours, for files that are written by hand: each term's ticks together, or whole frames one after the other."""
    history_newest_first: bool = False
    """Ours, too."""


class Action(Joints):
    """How actions become set-points."""

    class_type: str | None = None
    scale: ByJoint = 1.0
    use_default_offset: bool = True
    clip: Any = None


class Actuators(FilePart):
    """A group of servos with their gains, N·m/rad and N·m·s/rad."""

    joint_names_expr: Names = ALL
    stiffness: ByJoint
    damping: ByJoint


class CommandRanges(FilePart):
    """Low and high of V_x, V_y (m/s) and ω_z (rad/s)."""

    lin_vel_x: tuple[YamlNumber, YamlNumber]
    lin_vel_y: tuple[YamlNumber, YamlNumber]
    ang_vel_z: tuple[YamlNumber, YamlNumber]


class Environment(FilePart):
    """An environment; of observations and commands, only what the actor sees is read."""

    step_s: Annotated[YamlNumber, Field(gt=0.0)] | None = Field(default=None, validation_alias=AliasPath("sim", "dt"))
    """Time step of the physics."""
    decimation: Annotated[YamlNumber, Field(gt=0.0)] | None = None
    """Physics steps of one action."""
    pose: ByJoint = Field(validation_alias=AliasPath("scene", "robot", "init_state", "joint_pos"))
    """The default pose, rad."""
    actuators: dict[str, Actuators] = Field(validation_alias=AliasPath("scene", "robot", "actuators"))
    action: Action = Field(validation_alias=AliasPath("actions", "joint_pos"))
    observations: dict[str, Any] = Field(default_factory=dict)
    commands: dict[str, Any] | None = None

    @property
    def rate_hz(self) -> float | None:
        """One action in ``decimation`` physics steps; None where the file does not say."""
        return None if self.step_s is None or self.decimation is None else 1.0 / (self.step_s * self.decimation)

    def gains(self, key: str, joints: tuple[str, ...]) -> tuple[float, ...]:
        """``stiffness`` or ``damping`` of each joint, from the groups of actuators.

        Raises:
            BadInputError: A joint has none; the message names it.
        """
        found: dict[str, float] = {}
        where = "scene.robot.actuators"
        for name, group in self.actuators.items():
            named = [joint for joint in joints if any(e.fullmatch(joint) for e in group.joint_names_expr)]
            values = for_each_joint(getattr(group, key), named, f"{where}.{name}.{key}")
            found |= dict(zip(named, values, strict=True))
        missing = [joint for joint in joints if joint not in found]
        if missing:
            raise BadInputError(f"{where} has no {key} of {', '.join(missing)}")
        return tuple(found[joint] for joint in joints)

    def command_bounds(self, observed: str | None = None) -> tuple[Bounds, Bounds, tuple[str, ...]]:
        """Least and largest velocity command, and what was assumed where no command names a range.

        Args:
            observed: Name of the command that the policy observes, where the file tells it.

        Raises:
            BadInputError: There is no such command, or there are several and nothing tells which is observed.
        """
        commands = {name: c for name, c in (self.commands or {}).items() if observed in (None, name)}
        given = {n: c["ranges"] for n, c in commands.items() if isinstance(c, Mapping) and c.get("ranges")}
        if len(given) > 1 or (self.commands and not commands):
            raise BadInputError(
                f"the environment file has commands {', '.join(self.commands or ())}, and its observation names "
                f"{observed or 'none of them'}; name one as params.command_name of the observation's term"
            )
        if not given:
            told = "velocity commands within ±1 m/s, ±0.5 m/s, ±1 rad/s: no file names a range; --commands does"
            return (*DEFAULT_COMMANDS, (told,))
        ((name, data),) = given.items()
        ranges = parsed(CommandRanges, data, f"commands.{name}.ranges")
        low, high = zip(ranges.lin_vel_x, ranges.lin_vel_y, ranges.ang_vel_z, strict=True)
        return low, high, ()


class Agent(FilePart):
    """The learner's configuration, which Isaac Lab and mjlab write beside the environment's."""

    clip_actions: Annotated[YamlNumber, Field(gt=0.0)] | None = None
    """What its wrapper clips actions to, plus and minus."""
    obs_groups: dict[str, list[str]] | None = None
    """Groups of observations that actor and critic see."""

    @property
    def actor_groups(self) -> list[str]:
        """Groups of observations that the actor sees, one after the other."""
        groups = self.obs_groups or {}
        return groups.get("actor") or groups.get("policy") or ["policy"]


NOT_FLAT: Final = "{where} is false, so the network gets its ticks as rows; a network here gets one row of numbers"
_NORMALISERS: Final = (
    *("empirical_normalization", "policy.actor_obs_normalization", "actor.obs_normalization"),
    *("params.config.normalize_input", "normalize_input", "agent.state_preprocessor", "agent.observation_preprocessor"),
)
"""Where rsl-rl (three spellings), rl_games, Stable-Baselines3 and skrl say that the observation is normalised."""


def normaliser_of(agent: Mapping[str, Any]) -> str:
    """Where the learner's file says that the actor's observation was normalised; empty where it does not."""
    for place in _NORMALISERS:
        value: Any = agent
        for key in place.split("."):
            value = value.get(key) if isinstance(value, Mapping) else None
        if value:
            return f"{place}: {value!s:.40}"
    return ""


PartT = TypeVar("PartT", bound=FilePart)


def parsed(part: type[PartT], data: Any, source: str) -> PartT:
    """A part of a file, checked.

    Raises:
        BadInputError: A key is missing, or a value cannot be; the message names each.
    """
    try:
        return part.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"{source}:\n{explain(error)}") from error


def for_each_joint(
    value: float | dict[re.Pattern[str], float], joint_names: Sequence[str], source: str
) -> tuple[float, ...]:
    """A value a joint: one for all, or by regular expressions that match whole names.

    Raises:
        BadInputError: A joint is not matched.
    """
    if not isinstance(value, dict):
        return (value,) * len(joint_names)
    found = {name: own for pattern, own in value.items() for name in joint_names if pattern.fullmatch(name)}
    missing = [name for name in joint_names if name not in found]
    if missing:
        raise BadInputError(f"{source} says nothing of {', '.join(missing)}")
    return tuple(found[name] for name in joint_names)


class _PlainLoader(yaml.SafeLoader):
    """Reads every tag of Python as the plain value under it."""


def _plain(loader: yaml.SafeLoader, _suffix: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)  # type: ignore[arg-type]


_PlainLoader.add_multi_constructor("tag:yaml.org,2002:python/", _plain)


def read_data(path: Path) -> dict[str, Any]:
    """A file of settings as plain data. Raises BadInputError: the file cannot be read, or is not a mapping."""
    try:
        text = read_at_most(path, MAX_BYTES).decode("utf-8")
        data = json.loads(text) if path.suffix == ".json" else yaml.load(text, Loader=_PlainLoader)  # noqa: S506 - see it
    except (OSError, FileTooLargeError, UnicodeDecodeError, ValueError, RecursionError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInputError(
            f"environment file {path} cannot be read: {reason}; give the training run's env.yaml, or its JSON"
        ) from error
    if not isinstance(data, dict):
        raise BadInputError(f"environment file {path} holds no mapping; give the env.yaml of the training run")
    return data


def read_agent(environment: Path) -> dict[str, Any]:
    """The learner's configuration beside the environment's file; empty without one."""
    path = environment.with_name("agent.yaml")
    return read_data(path) if path.is_file() else {}
