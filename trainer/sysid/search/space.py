"""What is searched: parameters of effects of a model, with bounds and initial values, and their unit cube."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import Effect, Parameter
from spot_model.effects.registry import reference_of
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel

Array = NDArray[np.float64]


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
