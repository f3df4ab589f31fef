"""A scenario: everything that makes one fake robot what it is, as a YAML file.

schema: spot-rl/scenario/1
model:
  effects:
    - {effect: coulomb_friction, joints: [knees], level_nm: 0.4}
terrain: {friction: 0.4}
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, Field, PrivateAttr, ValidationError

from fake_robot.scenario.parts import (
    COMMAND_CHANNEL,
    STATE_CHANNEL,
    ArmConfig,
    BatteryConfig,
    ChannelConfig,
    ClockConfig,
    FrameConfig,
    JointControlConfig,
    MotionConfig,
    MotorConfig,
    Part,
    PayloadConfig,
    PhysicsConfig,
    PowerConfig,
    RealTimeConfig,
    SensorConfig,
    ServicesConfig,
    TerrainConfig,
)
from spot_model.errors import BadInputError
from spot_model.io.model_file import BUILT_IN, RobotModel, RobotName, model_from_data
from spot_model.io.settings import explain
from spot_model.io.yaml_text import read_yaml

SCHEMA: Final = "spot-rl/scenario/1"
SHIPPED_FOLDER: Final = Path(__file__).parent / "shipped"

DEFAULT_EFFECTS: Final[tuple[dict[str, Any], ...]] = tuple(
    effect for effect in BUILT_IN["paper_identified"].to_data()["effects"] if effect["effect"] != "command_delay"
)
"""What the paper identified on the real robot, but for the delay, which is the channels'."""


class ModelConfig(Part):
    """The robot's hidden truth, as in a model file, without its key ``schema``."""

    robot: RobotName = "spot"
    """The robot's body: `spot`, or `spot_with_arm`, whose streams have 19 joints."""
    effects: tuple[dict[str, Any], ...] = DEFAULT_EFFECTS
    """As in a [model file](files.md#model-file); they replace the default ones."""


class Scenario(Part):
    """A fake robot. Every key has a default, so that an empty file is the default robot."""

    schema_name: Literal["spot-rl/scenario/1"] = Field(default=SCHEMA, alias="schema")
    description: str = Field(default="", max_length=2000)
    """Text for the reader."""
    seed: int = Field(default=1, ge=0, le=2**63 - 1)
    """Of all noise, delays, drops and terrain; the same seed and the same commands give the same robot bit for bit."""
    time_mode: Literal["real_time", "lock_step"] = "real_time"
    """Robot time follows the host's clock, or passes only when asked."""
    model: ModelConfig = ModelConfig()
    physics: PhysicsConfig = PhysicsConfig()
    terrain: TerrainConfig = TerrainConfig()
    payload: PayloadConfig = PayloadConfig()
    arm: ArmConfig = ArmConfig()
    state_channel: ChannelConfig = STATE_CHANNEL
    command_channel: ChannelConfig = COMMAND_CHANNEL
    sensors: SensorConfig = SensorConfig()
    frames: FrameConfig = FrameConfig()
    clock: ClockConfig = ClockConfig()
    battery: BatteryConfig = BatteryConfig()
    motors: MotorConfig = MotorConfig()
    power: PowerConfig = PowerConfig()
    motion: MotionConfig = MotionConfig()
    joint_control: JointControlConfig = JointControlConfig()
    real_time: RealTimeConfig = RealTimeConfig()
    services: ServicesConfig = ServicesConfig()

    _robot_model: RobotModel = PrivateAttr()

    def model_post_init(self, _context: object) -> None:
        """Build the effects, so that a bad one is an error of the scenario."""
        self._robot_model = model_from_data(
            {"robot": self.model.robot, "effects": list(self.model.effects)}, source="model"
        )

    @property
    def robot_model(self) -> RobotModel:
        """The effects of the hidden truth, built."""
        return self._robot_model

    @property
    def has_arm(self) -> bool:
        """Whether the robot has an arm."""
        return self._robot_model.robot == "spot_with_arm"

    @property
    def is_lock_step(self) -> bool:
        """Whether robot time passes only when asked."""
        return self.time_mode == "lock_step"

    def with_changes(self, **changes: Any) -> Scenario:
        """A new scenario with some top-level keys changed; values may be parts, or plain data for them.

        Raises:
            BadInputError: A key or value is not allowed.
        """
        return scenario_from_data({**self.to_data(), **changes})

    def to_data(self) -> dict[str, Any]:
        """Plain data for YAML or JSON, complete with defaults."""
        data: dict[str, Any] = self.model_dump(mode="json", by_alias=True)
        return data


def scenario_from_data(data: Any, *, source: str = "scenario") -> Scenario:
    """Build a scenario from plain data.

    Raises:
        BadInputError: A key or value is not allowed; the message names it and ``source``.
    """
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise BadInputError(f"{source}: a scenario is a mapping of keys, not {data!r:.80}")
    try:
        # By way of JSON, pydantic's strict mode takes a list for a tuple, but neither "3" nor true for 3.
        return Scenario.model_validate_json(json.dumps(data, default=_plain), strict=True)
    except ValidationError as error:
        raise BadInputError(f"{source}:\n{explain(error, Scenario)}") from error
    except BadInputError as error:
        raise BadInputError(f"{source}: {error}") from error


def load_scenario(name_or_path: str | Path) -> Scenario:
    """A shipped scenario by name, or one from a YAML file. Raises BadInputError."""
    path = Path(name_or_path)
    shipped = SHIPPED_FOLDER / f"{name_or_path}.yaml"
    if path.suffix not in (".yaml", ".yml") and shipped.is_file():
        path = shipped
    if not path.is_file():
        raise BadInputError(
            f"scenario {str(name_or_path)!r} is not a file; allowed: a YAML file, or one of "
            f"{', '.join(shipped_names())}"
        )
    data = read_yaml(path, "scenario file")
    return scenario_from_data(data, source=f"scenario file {path}")


def shipped_names() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    return tuple(sorted(path.stem for path in SHIPPED_FOLDER.glob("*.yaml")))


def _plain(value: object) -> Any:
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else str(value)
