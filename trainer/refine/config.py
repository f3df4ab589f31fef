"""What a refinement searches and what it asks of the gait."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, model_from_data
from spot_model.io.models_file import load_models
from spot_model.io.settings import Settings, explain
from spot_model.io.yaml_text import read_yaml
from spot_model.robot.mjcf import MjcfOptions
from trainer.config.task_config import Range


class RefinedRobotConfig(Settings):
    """One robot on which the gait is tried."""

    model: str = "paper_identified"
    """Built-in model, a model file, or a models file, of which the first walks steadily, and all start."""
    effects: tuple[dict[str, Any], ...] = ()
    """More effects, as in a model file."""
    timestep_s: float = Field(default=0.005, gt=0.0, le=0.02)
    integrator: Literal["Euler", "implicitfast"] = "Euler"

    @field_validator("timestep_s")
    @classmethod
    def _divides_a_period(cls, value: float) -> float:
        if abs(0.02 / value - round(0.02 / value)) > 1e-6:
            raise ValueError("must divide the policy's period of 0.02 s")
        return value

    def robots(self) -> tuple[RobotModel, ...]:
        """The model, or models, with the further effects.

        Raises:
            BadInputError: The model or an effect is not allowed.
        """
        more = model_from_data({"schema": "spot-rl/model/1", "effects": list(self.effects)}, source="effects")
        return tuple(model.with_effects(*more.effects) for model in load_models(self.model))

    def mjcf(self) -> MjcfOptions:
        """Its physics."""
        return MjcfOptions(timestep_s=self.timestep_s, integrator=self.integrator)


class StartConfig(Settings):
    """Random starts, as in the randomised episodes, with a body mass, a floor and a number of robots of their own."""

    robots: int = Field(default=200, ge=1, le=10_000)
    added_body_mass_kg: Range = (0.0, 3.0)
    """Most starts that end in a fall are a heavy robot's,"""
    foot_friction: Range = (0.3, 1.0)
    """or on a slippery floor."""
    top_m_s: float = Field(default=3.0, gt=0.0)
    jump_s: float = Field(default=1.2, gt=0.0, le=10.0)
    """When the command jumps; it is watched for as long again."""
    weight: float = Field(default=30.0, ge=0.0)
    """Weight of the share that falls."""


class WeightConfig(Settings):
    """What a shortfall costs; the search minimises the sum."""

    duty_spread: float = Field(default=10.0, ge=0.0)
    """Weight of the mean, and again of the worst, difference of duty factors above what is allowed."""
    duty_spread_allowed: float = Field(default=0.065, ge=0.0)
    forward_error_per_m_s: float = Field(default=5.0, ge=0.0)
    other_error: float = Field(default=2.0, ge=0.0)
    """Weight of the mean error of V_x, V_y (m/s) and ω_z (rad/s) where the robot also turns or goes sideways or
    backwards.
    """
    top_speed_per_m_s: float = Field(default=2.0, ge=0.0)
    top_speed_wanted_m_s: float = Field(default=7.0, gt=0.0)
    fall: float = Field(default=2.0, ge=0.0)
    """Weight of each robot that falls in steady running."""


class RefineConfig(Settings):
    """A whole refinement."""

    schema_name: Literal["spot-rl/refine/1"] = Field(default="spot-rl/refine/1", alias="schema")
    generations: int = Field(default=30, ge=1, le=10_000)
    population: int = Field(default=14, ge=4, le=1000)
    sigma: float = Field(default=0.35, gt=0.0, le=2.0)
    """First step size, in units of each gain's own scale."""
    seed: int = Field(default=0, ge=0)
    speeds_m_s: tuple[float, ...] = Field(default=(0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 6, 7), min_length=1)
    others: tuple[tuple[float, float, float], ...] = (
        (0, 0, 0),
        (-1.5, 0, 0),
        (0, 1, 0),
        (0, 0, 1.5),
        (2, 0.5, 0),
        (2, -0.5, 0),
        (3, 0, 1),
        (3, 0, -1),
    )
    """V_x, V_y (m/s), ω_z (rad/s) of the robots that also turn or go sideways or backwards."""
    ramp_s: float = Field(default=4.0, gt=0.0, le=60.0)
    """From rest to the command."""
    settle_s: float = Field(default=1.0, ge=0.0, le=60.0)
    watch_s: float = Field(default=4.0, ge=1.0, le=60.0)
    """Time over which the gait is measured, s."""
    robots: tuple[RefinedRobotConfig, ...] = Field(default=(RefinedRobotConfig(),), min_length=1)
    starts: tuple[StartConfig, ...] = (StartConfig(),)
    weights: WeightConfig = WeightConfig()


def load_refine_config(path: Path | None) -> RefineConfig:
    """The config in a file; the defaults without one.

    Raises:
        BadInputError: The file cannot be read, or a key or value is not allowed.
    """
    if path is None:
        return RefineConfig()
    try:
        return RefineConfig.model_validate(read_yaml(path, "refinement"))
    except ValidationError as error:
        raise BadInputError(f"refinement {path}: {explain(error, RefineConfig)}") from error
