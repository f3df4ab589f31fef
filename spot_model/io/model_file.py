"""The model file: which robot, with which effects. One format for scenario, identification, diagnosis and training.

schema: spot-rl/model/1
robot: spot
effects:
  - {effect: coulomb_friction, joints: [knees], level_nm: 0.18}
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError

from spot_model.effects.base import Effect
from spot_model.effects.bodies import StowedArm
from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import CoulombFriction
from spot_model.effects.registry import make_effect, reference_of
from spot_model.effects.torque_limits import PositionTorqueLimit, TorqueLimit, TorqueSpeedCurve
from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.whole import write_new
from spot_model.io.yaml_text import read_yaml
from spot_model.robot import facts
from spot_model.robot.facts import KNEE_MOTOR_TORQUE_NM

SCHEMA: Final = "spot-rl/model/1"
RobotName = Literal["spot", "spot_with_arm"]


class ModelFileData(Settings):
    """The file's keys; each entry of ``effects`` has ``effect``, ``joints`` and the effect's parameters."""

    schema_name: Literal["spot-rl/model/1"] = Field(default=SCHEMA, alias="schema")
    robot: RobotName = "spot"
    """The robot's body. One of `spot_with_arm` has the effect `stowed_arm`, as published unless `effects` names it."""
    effects: tuple[dict[str, Any], ...] = ()
    """Each has `effect` (its name), `joints`, and the effect's parameters; missing parameters are at null."""


@dataclass(frozen=True)
class RobotModel:
    """A robot and the effects that act in it, in the order in which they act."""

    effects: tuple[Effect, ...] = ()
    """The effects, in that order."""

    @property
    def robot(self) -> RobotName:
        """The robot's body: with the arm's weight, or without."""
        return "spot_with_arm" if any(isinstance(effect, StowedArm) for effect in self.effects) else "spot"

    def with_effects(self, *effects: Effect) -> RobotModel:
        """The same model with more effects at the end. Raises BadInputError: one is no effect."""
        for effect in effects:
            given: object = effect
            if not isinstance(given, Effect):
                raise BadInputError(
                    f"effect {effect!r:.60} is no effect; allowed: objects of an effect's class (plain keys: "
                    "load_model(NAME, effects=[...]))"
                )
        return replace(self, effects=self.effects + effects)

    def to_data(self) -> dict[str, Any]:
        """Plain data for YAML or JSON; null parameters are left out.

        Raises:
            ValueError: A parameter is an array: only a single model goes into a file.
        """
        return {"schema": SCHEMA, "robot": self.robot, "effects": [_effect_data(e) for e in self.effects]}

    def digest(self) -> str:
        """SHA-256 of the model's data, hexadecimal."""
        return hashlib.sha256(json.dumps(self.to_data(), sort_keys=True).encode()).hexdigest()


def model_from_data(data: Any, *, source: str = "model") -> RobotModel:
    """Build a model from plain data.

    Raises:
        BadInputError: A key or value is not allowed; the message names it and ``source``.
    """
    try:
        parsed = ModelFileData.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"{source}:\n{explain(error, ModelFileData)}") from error
    effects = []
    for index, entry in enumerate(parsed.effects):
        fields = dict(entry)
        name = fields.pop("effect", None)
        if not isinstance(name, str):
            raise BadInputError(f"{source}: effects.{index} has no key 'effect'; name the effect there")
        try:
            effects.append(make_effect(name, fields))
        except BadInputError as error:
            raise BadInputError(f"{source}: effects.{index}: {error}") from error
    model = RobotModel(tuple(effects))
    return with_arm(model) if parsed.robot == "spot_with_arm" and model.robot == "spot" else model


def with_arm(model: RobotModel) -> RobotModel:
    """The same robot with its arm stowed on its back, as published."""
    return RobotModel((*model.effects, StowedArm.published()))


def load_model(name_or_path: str) -> RobotModel:
    """A built-in model (``ideal``, ``paper_initial``, ``paper_identified``, ``spot_with_arm``) or a YAML file's.

    Raises:
        BadInputError: No such model, or the file is not valid.
    """
    if name_or_path in BUILT_IN:
        return BUILT_IN[name_or_path]
    path = Path(name_or_path)
    if not path.is_file():
        raise BadInputError(
            f"model {name_or_path!r} is not a file; allowed: a YAML file, or one of {', '.join(BUILT_IN)}"
        )
    data = read_yaml(path, "model file")
    return model_from_data(data, source=f"model file {path}")


def save_model(model: RobotModel, path: Path) -> None:
    """Write a model as YAML; refuses to overwrite. Raises OutputExistsError: the file exists."""
    write_new(path, yaml.safe_dump(model.to_data(), sort_keys=False, allow_unicode=True))


def paper_model(actuator: facts.PaperActuator) -> RobotModel:
    """The paper's simulator: friction, hip limit, knee limits by speed and position, 5 ms delay."""
    return RobotModel(
        effects=(
            CoulombFriction(joints=("hips",), level_nm=actuator.hip_friction_nm),
            CoulombFriction(joints=("knees",), level_nm=actuator.knee_friction_nm),
            TorqueLimit(joints=("hips",), limit_nm=facts.HIP_TORQUE_LIMIT_NM),
            TorqueSpeedCurve(
                joints=("knees",),
                torque_max_nm=actuator.torque_max_nm,
                torque_min_nm=actuator.torque_min_nm,
                speed_max_rad_s=actuator.speed_max_rad_s,
                speed_min_rad_s=actuator.speed_min_rad_s,
                intersect_max_rad_s=actuator.intersect_max_rad_s,
                intersect_min_rad_s=actuator.intersect_min_rad_s,
            ),
            PositionTorqueLimit(motor_torque_nm=KNEE_MOTOR_TORQUE_NM),
            CommandDelay(delay_s=facts.TRAINING_COMMAND_DELAY_S),
        )
    )


BUILT_IN: Final = {
    "ideal": RobotModel(),
    "paper_initial": paper_model(facts.PAPER_INITIAL),
    "paper_identified": paper_model(facts.PAPER_IDENTIFIED),
    "spot_with_arm": with_arm(paper_model(facts.PAPER_IDENTIFIED)),
}


def _effect_data(effect: Effect) -> dict[str, Any]:
    data: dict[str, Any] = {"effect": reference_of(type(effect)), "joints": list(effect.joints)}
    for p in effect.parameters():
        value = getattr(effect, p.name)
        if np.ndim(value) != 0:
            raise ValueError(
                f"{effect.name}.{p.name} has shape {np.shape(value)}; only a single number goes into a file"
            )
        if float(value) != p.null or not math.isfinite(p.null):
            data[p.name] = float(value)
    return {k: v for k, v in data.items() if not (isinstance(v, float) and math.isinf(v))}
