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

from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.yaml_text import read_yaml
from spot_model.robot import facts
from spot_model.robot.facts import Array

PerJoint = float | tuple[float, ...]


class DriveNumbers(Settings):
    """What each joint's drive adds to the rigid bodies, as a diagnosis found it; a number stands for all joints."""

    inertia_kg_m2: PerJoint = 0.0
    """Of the rotor, at the joint (MuJoCo: `armature`)."""
    friction_nm: PerJoint = 0.0
    """Dry friction (`frictionloss`)."""
    damping_nm_s_per_rad: PerJoint = 0.0
    """Viscous friction (`damping`)."""
    offset_nm: PerJoint = 0.0
    """A constant torque beside the servo's."""
    delay_s: float = 0.0
    """From a command's stamp to its torque."""


class RobotFile(Settings):
    """The file's keys. A number stands for all joints."""

    schema_name: Literal["spot-rl/robot/1"] = Field(alias="schema")
    name: str
    joint_names: tuple[str, ...] = Field(min_length=1)
    """Names of the joints as in the logs, in the logs' order."""
    kp_nm_per_rad: PerJoint | None = None
    """Servo gains, where the logs hold none."""
    kd_nm_s_per_rad: PerJoint | None = None
    position_low_rad: PerJoint | None = None
    """Joint stops: near them a load is not the motor's, and far beyond them a unit is wrong."""
    position_high_rad: PerJoint | None = None
    torque_limit_nm: PerJoint | None = None
    """No load of this robot is much larger; one that is has another unit."""
    mjcf: str | None = None
    """Rigid bodies with these joints, beside this file; friction and rotor inertia in it do not count."""
    load: Literal["measured", "from_motion"] = "measured"
    """``from_motion``: loads are what the MJCF needs for the motion; for a robot on a stand, with no torque sensors
    at its links."""

    drive: DriveNumbers | None = None
    """In the files that a diagnosis writes; predictions use it, a diagnosis does not."""

    @model_validator(mode="after")
    def _fits(self) -> RobotFile:
        if len(set(self.joint_names)) != len(self.joint_names):
            raise ValueError("joint_names has a name twice")
        for name, value in {**dict(self), **dict(self.drive or ())}.items():
            if name in ("schema_name", "joint_names"):
                continue
            if isinstance(value, tuple) and len(value) != len(self.joint_names):
                raise ValueError(f"{name} has {len(value)} values; allowed: 1, or one for each joint in joint_names")
        if (self.position_low_rad is None) != (self.position_high_rad is None):
            raise ValueError("position_low_rad and position_high_rad come together; give both or neither")
        if self.is_from_motion and self.mjcf is None:
            raise ValueError("load: from_motion needs the key mjcf")
        return self

    def each(self, value: PerJoint | None) -> Array | None:
        """A value for each joint, shape (J,)."""
        return None if value is None else np.broadcast_to(value, (len(self.joint_names),)).astype(np.float64)

    @property
    def is_from_motion(self) -> bool:
        """Whether loads are computed from the motion."""
        return self.load == "from_motion"

    @property
    def limits_rad(self) -> tuple[Array, Array] | None:
        """Joint stops, low and high, where they are known."""
        low, high = self.each(self.position_low_rad), self.each(self.position_high_rad)
        return None if low is None or high is None else (low, high)


SPOT: Final = RobotFile(
    schema="spot-rl/robot/1",
    name="spot",
    joint_names=facts.JOINT_NAMES,
    position_low_rad=tuple(facts.POSITION_LOW_RAD),
    position_high_rad=tuple(facts.POSITION_HIGH_RAD),
)


def load_robot(path: Path) -> RobotFile:
    """Read a robot file; the name of its MJCF becomes a path from here.

    Raises:
        BadInputError: It cannot be read, a key or value in it is wrong, or its MJCF is not there.
    """
    data = read_yaml(path, "robot file")
    try:
        robot = RobotFile.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"robot file {path} is not valid:\n{explain(error, RobotFile)}") from error
    if robot.mjcf is None:
        return robot
    mjcf = path.parent / robot.mjcf
    if not mjcf.is_file():
        raise BadInputError(f"robot file {path}: mjcf {mjcf} is not a file; allowed: an MJCF beside the robot file")
    return robot.model_copy(update={"mjcf": str(mjcf)})
