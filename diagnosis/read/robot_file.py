"""``--robot FILE.yaml``: another robot than Spot: its joints, gains, stops and, where there is one, its MJCF.

schema: spot-rl/robot/1
name: pendulum
joint_names: [pivot]
kp_nm_per_rad: 0
kd_nm_s_per_rad: 0
position_low_rad: -20
position_high_rad: 20
mjcf: pendulum.xml
load: from_motion
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError, model_validator

from diagnosis.read.recording import Array
from spot_model.errors import BadInputError
from spot_model.io.settings import Settings
from spot_model.io.validation import explain
from spot_model.robot import facts

SCHEMA: Final = "spot-rl/robot/1"
PerJoint = float | tuple[float, ...]


class RobotFile(Settings):
    """The file's keys. A number stands for all joints."""

    schema_name: Literal["spot-rl/robot/1"] = Field(alias="schema")
    name: str
    joint_names: tuple[str, ...] = Field(min_length=1)
    """As the logs name them, in the logs' order."""
    kp_nm_per_rad: PerJoint | None = None
    """Servo gains, where the logs hold none."""
    kd_nm_s_per_rad: PerJoint | None = None
    position_low_rad: PerJoint | None = None
    """Joint stops: near them a load is not the motor's, and far beyond them a unit is wrong."""
    position_high_rad: PerJoint | None = None
    torque_limit_nm: PerJoint | None = None
    """No load of this robot is much larger; one that is has another unit."""
    mjcf: str | None = None
    """Rigid bodies with these joints, beside this file; friction and armature in it do not count."""
    load: Literal["measured", "from_motion"] = "measured"
    """``from_motion``: loads are what the MJCF needs for the motion; for a robot on a stand, with no torque sensors
    at its links."""

    @model_validator(mode="after")
    def _fits(self) -> RobotFile:
        if len(set(self.joint_names)) != len(self.joint_names):
            raise ValueError("joint_names has a name twice")
        for name in ("kp_nm_per_rad", "kd_nm_s_per_rad", "position_low_rad", "position_high_rad", "torque_limit_nm"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != len(self.joint_names):
                raise ValueError(f"{name} has {len(value)} values; allowed: 1, or one for each joint in joint_names")
        if (self.position_low_rad is None) != (self.position_high_rad is None):
            raise ValueError("position_low_rad and position_high_rad come together; give both or neither")
        if self.load == "from_motion" and self.mjcf is None:
            raise ValueError("load: from_motion needs the key mjcf")
        return self


@dataclass(frozen=True)
class RobotDescription:
    """A robot file, read; arrays have one value a joint, in the order of the names."""

    name: str
    joint_names: tuple[str, ...]
    kp_nm_per_rad: Array | None
    kd_nm_s_per_rad: Array | None
    limits_rad: tuple[Array, Array] | None
    torque_limit_nm: Array | None
    mjcf: Path | None
    has_load_from_motion: bool


SPOT: Final = RobotDescription(
    name="spot",
    joint_names=facts.JOINT_NAMES,
    kp_nm_per_rad=None,
    kd_nm_s_per_rad=None,
    limits_rad=(np.asarray(facts.POSITION_LOW_RAD), np.asarray(facts.POSITION_HIGH_RAD)),
    torque_limit_nm=None,
    mjcf=None,
    has_load_from_motion=False,
)


def load_robot(path: Path) -> RobotDescription:
    """Read a robot file.

    Raises:
        BadInputError: It cannot be read, a key or value in it is wrong, or its MJCF is not there.
    """
    try:
        data: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadInputError(f"robot file {path} cannot be read: {error}") from error
    if not isinstance(data, dict):
        raise BadInputError(f"robot file {path} must hold keys and values; it begins with 'schema: {SCHEMA}'")
    try:
        file = RobotFile.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"robot file {path} is not valid:\n{explain(error, RobotFile)}") from error
    mjcf = path.parent / file.mjcf if file.mjcf is not None else None
    if mjcf is not None and not mjcf.is_file():
        raise BadInputError(f"robot file {path}: mjcf {mjcf} is not a file; allowed: an MJCF beside the robot file")

    def each(value: PerJoint | None) -> Array | None:
        return None if value is None else np.broadcast_to(value, (len(file.joint_names),)).astype(np.float64)

    low, high = each(file.position_low_rad), each(file.position_high_rad)
    return RobotDescription(
        name=file.name,
        joint_names=file.joint_names,
        kp_nm_per_rad=each(file.kp_nm_per_rad),
        kd_nm_s_per_rad=each(file.kd_nm_s_per_rad),
        limits_rad=None if low is None or high is None else (low, high),
        torque_limit_nm=each(file.torque_limit_nm),
        mjcf=mjcf,
        has_load_from_motion=file.load == "from_motion",
    )
