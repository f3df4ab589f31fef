"""The configuration of an identification, and the space of parameters that it searches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field, ValidationError

from spot_model.effects.base import Effect, Parameter
from spot_model.effects.registry import make_effect, reference_of
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, load_model
from spot_model.io.settings import Settings, explain
from spot_model.io.yaml_text import read_yaml
from spot_model.robot import facts
from spot_model.robot.facts import Array


@dataclass(frozen=True)
class SearchParameter:
    """One number that the search may change."""

    effect_index: int
    """Which effect of the model."""
    effect: str
    joints: tuple[str, ...]
    parameter: str
    unit: str
    initial: float
    low: float
    high: float
    fraction_of: str = ""
    """Where set, the search's own coordinate is this parameter over that one (of the same effect), within 0 to 1."""

    @property
    def name(self) -> str:
        """Unique within a model, as ``effect[joints].parameter``."""
        return f"{self.effect}[{','.join(self.joints)}].{self.parameter}"


@dataclass(frozen=True)
class SearchSpace:
    """A model, and which of its parameters are searched."""

    model: RobotModel
    parameters: tuple[SearchParameter, ...]

    @property
    def n(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(p.name for p in self.parameters)

    @property
    def initial(self) -> Array:
        """Initial physical values, shape (n,)."""
        return np.array([p.initial for p in self.parameters])

    def values_of_unit(self, unit: Array) -> Array:
        """Physical values of points of the unit cube, shape (..., n)."""
        unit = np.asarray(unit, dtype=np.float64)
        values = np.empty_like(unit)
        for i, p in enumerate(self.parameters):
            values[..., i] = p.low + unit[..., i] * (p.high - p.low)
        for i, p in enumerate(self.parameters):
            if p.fraction_of:
                values[..., i] = unit[..., i] * values[..., self._whole_of(i)]
        return values

    def unit_of_values(self, values: Array) -> Array:
        """The inverse of :meth:`values_of_unit`."""
        values = np.asarray(values, dtype=np.float64)
        unit = np.empty_like(values)
        for i, p in enumerate(self.parameters):
            if p.fraction_of:
                unit[..., i] = values[..., i] / values[..., self._whole_of(i)]
            else:
                unit[..., i] = (values[..., i] - p.low) / (p.high - p.low)
        return unit

    def within_bounds(self, values: Array) -> Array:
        """Physical values, shape (..., n), brought within the bounds of the search."""
        return self.values_of_unit(np.clip(self.unit_of_values(values), 0.0, 1.0))

    def effects(self, values: Array, sims_per_candidate: int = 1) -> tuple[Effect, ...]:
        """The model's effects with per-simulation values.

        Args:
            values: Physical values. Shape (n_candidates, n).
            sims_per_candidate: Simulations in a row that share a candidate.

        Returns:
            Effects whose searched parameters have shape (n_candidates · sims_per_candidate, 1).
        """
        changes: dict[int, dict[str, Any]] = {}
        for i, p in enumerate(self.parameters):
            column = np.repeat(values[:, i], sims_per_candidate)[:, None]
            changes.setdefault(p.effect_index, {})[p.parameter] = column
        return tuple(replace(e, **changes.get(i, {})) for i, e in enumerate(self.model.effects))

    def model_with(self, values: Array) -> RobotModel:
        """The model with single values, shape (n,), for a model file."""
        changes: dict[int, dict[str, Any]] = {}
        for p, value in zip(self.parameters, values, strict=True):
            changes.setdefault(p.effect_index, {})[p.parameter] = float(value)
        effects = tuple(replace(e, **changes.get(i, {})) for i, e in enumerate(self.model.effects))
        return replace(self.model, effects=effects)

    def _whole_of(self, index: int) -> int:
        p = self.parameters[index]
        return next(
            i
            for i, other in enumerate(self.parameters)
            if other.effect_index == p.effect_index and other.parameter == p.fraction_of
        )


def find_parameter(model: RobotModel, effect: str, joints: tuple[str, ...], parameter: str) -> tuple[int, Parameter]:
    """The effect's index in the model and the parameter's declaration.

    Raises:
        BadInputError: The model has no such effect on these joints, or the effect no such parameter.
    """
    for index, candidate in enumerate(model.effects):
        if effect in (candidate.name, reference_of(type(candidate))) and candidate.joints == joints:
            for declared in candidate.parameters():
                if declared.name == parameter:
                    return index, declared
            allowed = ", ".join(p.name for p in candidate.parameters())
            raise BadInputError(f"effect {effect} has no parameter {parameter!r}; allowed: {allowed}")
    present = ", ".join(f"{e.name} on {list(e.joints)}" for e in model.effects) or "none"
    raise BadInputError(f"the model has no effect {effect!r} on joints {list(joints)}; it has: {present}")


SCHEMA: Final = "spot-rl/sysid/1"

CONTACT_CHOICES_S: Final = (0.0075, 0.01, 0.0125, 0.016, 0.02, 0.025)
"""Contact time constants that are tried, stiff to soft; MuJoCo's default is 0.02 s."""


class ParameterConfig(Settings):
    """One searched parameter: an effect of the model, its joints, the parameter, and the bounds of the search."""

    effect: str
    """Name of a built-in effect, or ``module:Class``."""
    joints: tuple[str, ...] = ("all",)
    """Joints on which it acts, as in the model."""
    parameter: str
    """Name of its parameter."""
    initial: float
    """Where the search starts."""
    low: float
    """Lower bound of the search."""
    high: float
    """Upper bound."""
    fraction_of: str = ""
    """Search this parameter as a share (0 to 1) of another one of the same effect that is searched too."""


def _paper_parameters() -> tuple[ParameterConfig, ...]:
    start = facts.PAPER_INITIAL

    def curve(parameter: str, initial: float, low: float, high: float, fraction_of: str = "") -> ParameterConfig:
        return ParameterConfig(
            effect="torque_speed_curve",
            joints=("knees",),
            parameter=parameter,
            initial=initial,
            low=low,
            high=high,
            fraction_of=fraction_of,
        )

    def friction(joints: str, initial: float) -> ParameterConfig:
        return ParameterConfig(
            effect="coulomb_friction", joints=(joints,), parameter="level_nm", initial=initial, low=0.0, high=1.5
        )

    return (
        friction("hips", start.hip_friction_nm),
        friction("knees", start.knee_friction_nm),
        curve("torque_max_nm", start.torque_max_nm, 20.0, 160.0),
        curve("torque_min_nm", start.torque_min_nm, -160.0, -20.0),
        curve("speed_max_rad_s", start.speed_max_rad_s, 8.0, 40.0),
        curve("speed_min_rad_s", start.speed_min_rad_s, -40.0, -8.0),
        curve("intersect_max_rad_s", start.intersect_max_rad_s, 0.0, 40.0, fraction_of="speed_max_rad_s"),
        curve("intersect_min_rad_s", start.intersect_min_rad_s, -40.0, 0.0, fraction_of="speed_min_rad_s"),
    )


class SearchConfig(Settings):
    """CMA-ES. Defaults: the paper's 100 iterations of 10 samples."""

    generations: int = Field(default=100, ge=1, le=100_000)
    """Iterations of the search."""
    population: int = Field(default=10, ge=4, le=10_000)
    """Candidates per generation."""
    sigma: float = Field(default=0.2, gt=0.0, le=1.0)
    """Initial standard deviation as a share of each parameter's bounds."""
    seed: int = Field(default=0, ge=0)


GPU_POPULATION: Final = 250
GPU_GENERATIONS: Final = 6
"""On a GPU a generation takes as long with 250 candidates of four sequences as with ten, so that few and large ones
replace many and small ones (``spot-rl bench sysid --device cuda``)."""


class SimulationConfig(Settings):
    """How a candidate is simulated."""

    robots_per_sequence: int = Field(default=1, ge=1, le=64)
    """Simulated robots per command sequence, each started like one of its real runs."""
    final_robots_per_sequence: int = Field(default=5, ge=1, le=64)
    """Simulated robots per command sequence for the scores in the result: runs with the same model differ."""
    timestep_s: float = Field(default=0.002, gt=0.0, le=0.005)
    """Physics step."""
    foot_friction: float = Field(default=0.8, gt=0.0, le=2.0)
    """Friction coefficient of feet and ground."""
    contact_time_constant_s: float | None = Field(default=None, gt=0.0, le=0.1)
    """MuJoCo's contact time constant; none: chosen from six values by score, before the search."""
    measured_delay: bool = True
    """Whether the model's command delay is set to the logs' median, from state to servo."""
    measured_inertia: bool = True
    """Whether the model gets the rotor inertia that the logged torques show; the paper's model has none."""


class SysidConfig(Settings):
    """A whole identification."""

    schema_name: Literal["spot-rl/sysid/1"] = Field(default=SCHEMA, alias="schema")
    model: str = "paper_initial"
    """The nominal model: a built-in name or a model file. A searched effect that it lacks is added, at null."""
    parameters: tuple[ParameterConfig, ...] = Field(default_factory=_paper_parameters, min_length=1)
    search: SearchConfig = SearchConfig()
    simulation: SimulationConfig = SimulationConfig()
    sequence_weights: dict[str, float] = Field(default_factory=dict)
    """Weight of a command sequence in the score; 1 by default."""

    def space(self) -> SearchSpace:
        """The search space.

        Raises:
            BadInputError: An effect or parameter does not exist, is twice in the list, or its bounds do not fit.
        """
        model = self._whole_model()
        parameters = []
        for number, entry in enumerate(self.parameters):
            where = f"parameters.{number}"
            try:
                index, declared = find_parameter(model, entry.effect, entry.joints, entry.parameter)
            except BadInputError as error:
                raise BadInputError(f"{where}: {error}") from error
            _check_bounds(where, entry, declared.low, declared.high, self.parameters)
            parameters.append(SearchParameter(effect_index=index, unit=declared.unit, **entry.model_dump()))
        space = SearchSpace(model, tuple(parameters))
        twice = {name for name in space.names if space.names.count(name) > 1}
        if twice:
            raise BadInputError(f"parameters: {', '.join(sorted(twice))} is listed twice; list it once")
        return space

    def _whole_model(self) -> RobotModel:
        """The model, with the searched effects that it lacks."""
        model = load_model(self.model)
        present = {effect.name for effect in model.effects}
        for name, joints in dict.fromkeys((entry.effect, entry.joints) for entry in self.parameters):
            if name not in present:
                try:
                    model = model.with_effects(make_effect(name, {"joints": joints}))
                except BadInputError as error:
                    raise BadInputError(f"parameters: {error}") from error
        return model


def default_config(device: str) -> SysidConfig:
    """The configuration where none is given: the paper's search, on a GPU in generations that fill it."""
    if device == "cpu":
        return SysidConfig()
    return SysidConfig(search=SearchConfig(population=GPU_POPULATION, generations=GPU_GENERATIONS))


def sysid_config_from_data(data: Any, *, source: str) -> SysidConfig:
    """Check plain data. Raises BadInputError: a key or a value is not allowed; the message names it."""
    try:
        return SysidConfig.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"{source}:\n{explain(error, SysidConfig)}") from error


def load_sysid_config(path: Path) -> SysidConfig:
    """Read a configuration from YAML. Raises BadInputError: the file cannot be read, or is not valid."""
    data = read_yaml(path, "config")
    return sysid_config_from_data(data if data is not None else {}, source=f"config {path}")


def _check_bounds(
    where: str, entry: ParameterConfig, low: float, high: float, others: tuple[ParameterConfig, ...]
) -> None:
    if not entry.low < entry.high:
        raise BadInputError(f"{where}: low = {entry.low:g} and high = {entry.high:g}; low must be below high")
    if entry.low < low or entry.high > high:
        raise BadInputError(
            f"{where}: bounds {entry.low:g} to {entry.high:g}; "
            f"{entry.effect}.{entry.parameter} allows {low:g} to {high:g}"
        )
    if not entry.low <= entry.initial <= entry.high:
        raise BadInputError(f"{where}: initial = {entry.initial:g}; allowed: {entry.low:g} to {entry.high:g}")
    if entry.fraction_of:
        same = [o for o in others if o.effect == entry.effect and o.joints == entry.joints and not o.fraction_of]
        if entry.fraction_of not in [o.parameter for o in same]:
            allowed = ", ".join(o.parameter for o in same) or "none"
            raise BadInputError(
                f"{where}: fraction_of = {entry.fraction_of!r}; allowed: another searched parameter of "
                f"{entry.effect} on the same joints: {allowed}"
            )
