"""Joint experiments: scripted motions of the standing robot that need no policy, as YAML files.

schema: spot-rl/joint-experiment/1
name: sweep_fl_kn
kind: sweep
duration_s: 12
joint: fl_kn
amplitude_rad: 0.2
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.yaml_text import read_yaml
from spot_model.robot import facts

SCHEMA: Final = "spot-rl/joint-experiment/1"
LIFT_S: Final = 3.0
"""Time that a sweep with a lifted leg takes to shift the body and lift the leg, and again to come back, s."""

ON_GROUND_RAD: Final = 0.15
"""A joint whose foot stays on the ground swings by no more: it moves the body."""


class _Experiment(Settings):
    schema_name: Literal["spot-rl/joint-experiment/1"] = Field(default=SCHEMA, alias="schema")
    name: str = Field(min_length=1, max_length=100)
    duration_s: float = Field(ge=4.0, le=60.0)
    kp_nm_per_rad: float = Field(default=250.0, ge=150.0, le=300.0)
    kd_nm_s_per_rad: float = Field(default=5.0, ge=2.0, le=6.0)
    torque_nm: float = Field(
        default=80.0, ge=30.0, le=100.0, description="Set-points stay so near that no servo asks for more at rest."
    )


class Standing(_Experiment):
    """The body's weight goes slowly round over the four feet."""

    kind: Literal["standing"] = "standing"
    shift_x_m: float = Field(default=0.04, ge=0.0, le=0.08)
    shift_y_m: float = Field(default=0.04, ge=0.0, le=0.08)
    frequency_hz: float = Field(default=0.3, ge=0.05, le=1.5)


class Squat(_Experiment):
    """The body goes down and up."""

    kind: Literal["squat"] = "squat"
    depth_m: float = Field(default=0.10, ge=0.0, le=0.16)
    frequency_hz: float = Field(default=0.5, ge=0.05, le=2.0)


class Sweep(_Experiment):
    """One joint swings with rising frequency, its leg in the air or, by less, on the ground."""

    kind: Literal["sweep"] = "sweep"
    joint: str
    amplitude_rad: float = Field(default=0.2, ge=0.0, le=0.6)
    start_hz: float = Field(default=0.3, ge=0.05, le=5.0)
    end_hz: float = Field(default=3.0, ge=0.05, le=5.0)
    is_leg_lifted: bool = True

    @model_validator(mode="after")
    def _joint_and_time(self) -> Sweep:
        if self.joint not in facts.JOINT_NAMES:
            raise ValueError(f"joint is {self.joint!r}; allowed: {', '.join(facts.JOINT_NAMES)}")
        if not self.is_leg_lifted and self.amplitude_rad > ON_GROUND_RAD:
            raise ValueError(
                f"amplitude_rad is {self.amplitude_rad:g}; up to {ON_GROUND_RAD:g} with the leg on the ground"
            )
        if self.is_leg_lifted and self.duration_s < 2.0 * LIFT_S + 2.0:
            raise ValueError(f"duration_s must be at least {2.0 * LIFT_S + 2.0:g} for a leg that is lifted")
        return self


JointExperiment = Standing | Squat | Sweep
_ADAPTER: Final[TypeAdapter[JointExperiment]] = TypeAdapter(Annotated[JointExperiment, Field(discriminator="kind")])


def joint_experiment_from_data(data: Any, *, source: str = "joint experiment") -> JointExperiment:
    """A joint experiment from plain data.

    Raises:
        BadInputError: A key or value is not allowed; the message names it and ``source``.
    """
    try:
        # By way of JSON, pydantic's strict mode takes a list for a tuple, but neither "3" nor true for 3.
        return _ADAPTER.validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise BadInputError(f"{source}:\n{explain(error)}") from error


def load_joint_experiment(path: Path) -> JointExperiment:
    """Read a joint experiment. Raises BadInputError: the file cannot be read or is not valid."""
    return joint_experiment_from_data(read_yaml(path, "joint experiment"), source=f"joint experiment {path}")
