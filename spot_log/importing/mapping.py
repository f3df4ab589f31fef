"""The mapping file: the array, unit, order and clock of each signal in a foreign recording.

schema: spot-rl/import/1
joint_names: [hip, knee]
time: {from: t, unit: s, clock: relative}
signals:
  position: {from: dof_pos, unit: rad}
  load: {from: ["tau_{joint}"], unit: N·m}
  kp: {value: 20, unit: N·m/rad}
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from spot_model.errors import BadInputError
from spot_model.io.settings import explain
from spot_model.io.yaml_text import read_yaml
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES

SCHEMA: Final = "spot-rl/import/1"

JOINTS: Final = -1


class MappedSignal(NamedTuple):
    """What a signal is, and where the log holds it."""

    quantity: str
    width: int
    """Columns; :data:`JOINTS` for one a joint, 0 where that is the source's business."""
    record: str
    """Kind of record: state, command, tick or slow."""
    field: str = ""
    """The record's field that holds it as it is."""


SIGNALS: Final = {
    "position": MappedSignal("angle", JOINTS, "state", "position_rad"),
    "velocity": MappedSignal("angular velocity", JOINTS, "state", "velocity_rad_s"),
    "load": MappedSignal("torque", JOINTS, "state", "load_nm"),
    "setpoint_position": MappedSignal("angle", JOINTS, "command", "position_rad"),
    "setpoint_velocity": MappedSignal("angular velocity", JOINTS, "command", "velocity_rad_s"),
    "feedforward": MappedSignal("torque", JOINTS, "command", "load_nm"),
    "kp": MappedSignal("stiffness", JOINTS, "command", "kp_nm_per_rad"),
    "kd": MappedSignal("damping", JOINTS, "command", "kd_nm_s_per_rad"),
    "motor_temperature": MappedSignal("temperature", JOINTS, "slow"),
    "position_of_body_in_odom": MappedSignal("length", 3, "state", "position_of_body_in_odom_m"),
    "odom_from_body": MappedSignal("none", 4, "state", "odom_from_body_wxyz"),
    "linear_vel_of_body_in_odom": MappedSignal("velocity", 3, "state"),
    "linear_vel_of_body_in_body": MappedSignal("velocity", 3, "state"),
    "angular_vel_of_body_in_odom": MappedSignal("angular velocity", 3, "state"),
    "angular_vel_of_body_in_body": MappedSignal("angular velocity", 3, "state"),
    "acceleration_of_imu_in_link": MappedSignal("acceleration", 3, "state"),
    "angular_vel_of_link_in_link": MappedSignal("angular velocity", 3, "state"),
    "foot_contact": MappedSignal("none", 0, "state"),
    "velocity_command": MappedSignal("none", 3, "tick", "velocity_command"),
    "action": MappedSignal("none", 0, "tick", "action"),
    "observation": MappedSignal("none", 0, "tick", "observation"),
    "battery_voltage": MappedSignal("voltage", 1, "slow", "battery_voltage_v"),
    "battery_current": MappedSignal("current", 1, "slow", "battery_current_a"),
    "battery_charge": MappedSignal("share", 1, "slow", "battery_charge_percent"),
}


def signals_of(record: str) -> tuple[str, ...]:
    """The signals that a kind of record holds."""
    return tuple(name for name, signal in SIGNALS.items() if signal.record == record)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class TimeMapping(_Strict):
    """When each row was sampled: a column, or a constant rate."""

    source: str | None = Field(default=None, alias="from")
    """Name of the column or array of stamps."""
    unit: str = "s"
    """s, ms, us, µs or ns."""
    rate_hz: Annotated[float, Field(gt=0)] | None = None
    """Constant rate of the rows, for a recording without stamps."""
    clock: Literal["relative", "unix"] = "relative"
    """``relative``: from the start of the recording; ``unix``: since 1970."""
    file: str | None = None
    """Another file beside the main one."""

    @model_validator(mode="after")
    def _one_of_two(self) -> TimeMapping:
        if (self.source is None) == (self.rate_hz is None):
            raise ValueError("give either 'from' (a column of stamps) or 'rate_hz' (a constant rate)")
        return self


class SignalMapping(_Strict):
    """Where one signal is: an array by name, a list of columns, or a constant value."""

    source: str | tuple[str, ...] | None = Field(default=None, alias="from")
    """An array (n, width), or columns; ``{joint}`` and ``{foot}`` in a column's name stand for every one of them."""
    value: float | tuple[float, ...] | None = None
    """A constant, one or one a joint, in place of ``from``."""
    select: tuple[int | None, ...] | None = None
    """For arrays of more than two axes: an index an axis after the first, null for the axis to keep."""
    unit: str | None = None
    """One of the units of the signal's quantity, below."""
    scale: float | tuple[float, ...] = 1.0
    """Factor after the unit's, one or one a column of the source; −1 turns a sign."""
    offset: float | tuple[float, ...] = 0.0
    """Added after the factors, in our unit."""
    order: Literal["wxyz", "xyzw"] | None = None
    """Order of a quaternion's components; required for one."""
    file: str | None = None
    """Another file beside the main one, row by row the same instants."""

    @model_validator(mode="after")
    def _one_of_two(self) -> SignalMapping:
        if (self.source is None) == (self.value is None):
            raise ValueError("give either 'from' (an array or columns) or 'value' (a constant)")
        return self


class Mapping(_Strict):
    """The whole file."""

    schema_name: Literal["spot-rl/import/1"] = Field(alias="schema")
    time: TimeMapping
    signals: dict[str, SignalMapping]
    """Where each signal is, by its name; see below."""
    joint_names: tuple[str, ...] = JOINT_NAMES
    """Joints in the log's order."""
    source_joint_names: tuple[str, ...] | None = None
    """The joints in the source's order, where that is another or has more, such as an arm's, which are left out."""
    continuous_joints: tuple[str, ...] = ()
    """Joints that turn without a stop: any number of turns is right for them."""
    names_in_source: dict[str, str] = {}
    """What the source calls a joint or a foot, where it has another name: the text for `{joint}` or `{foot}`."""
    foot_names: tuple[str, ...] = LEG_NAMES
    """Feet in the log's order; an empty list for a robot without contacts."""
    robot: str = ""
    """Name of the robot: logs of one robot share it."""
    command_sequence: str = ""
    """Name of the motion; runs of the same motion can be compared."""
    repeat: int = 0
    """Number of the run of that motion, from 0."""
    episode: Annotated[int, Field(ge=0)] | None = None
    """Which episode of a LeRobot data set; `--episode` of the command says another."""
    labels: dict[str, str] = {}
    """Further words about the run, such as `{surface: grass}`."""
    accept_doubts: bool = False
    """Write the log also where a check finds what no robot can have done; its page repeats the doubts."""

    @field_validator("signals")
    @classmethod
    def _known_signals(cls, signals: dict[str, SignalMapping]) -> dict[str, SignalMapping]:
        unknown = sorted(set(signals) - set(SIGNALS))
        if unknown:
            raise ValueError(f"unknown signal {unknown[0]!r}; allowed: {', '.join(SIGNALS)}")
        if "position" not in signals:
            raise ValueError("the signal 'position' is missing; a log needs joint positions")
        return signals

    @model_validator(mode="after")
    def _same_joints(self) -> Mapping:
        names = self.source_joint_names
        if len(set(self.joint_names)) != len(self.joint_names):
            raise ValueError("joint_names has a name twice")
        if names is not None and (len(set(names)) != len(names) or not set(names) >= set(self.joint_names)):
            raise ValueError("source_joint_names must hold the names of joint_names, each once, in the source's order")
        return self

    @property
    def source_joints(self) -> tuple[str, ...]:
        """Joints in the source's order."""
        return self.source_joint_names or self.joint_names


EXAMPLES: Final = Path(__file__).with_name("examples")


def shipped_names() -> tuple[str, ...]:
    """Mappings that the package holds, by name."""
    return tuple(sorted(f.stem for f in EXAMPLES.glob("*.yaml") if not f.stem.endswith("_robot")))


def load_mapping(path: Path) -> Mapping:
    """Read a mapping file, or one that the package holds by its name. Raises BadInputError."""
    if not path.exists() and str(path) in shipped_names():
        path = EXAMPLES / f"{path}.yaml"
    data = read_yaml(path, "mapping")
    if not isinstance(data, dict):
        raise BadInputError(f"mapping {path} must hold keys and values; it begins with 'schema: {SCHEMA}'")
    try:
        return Mapping.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"mapping {path} is not valid:\n{explain(error, Mapping)}") from error
