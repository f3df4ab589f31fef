"""What a nominal model holds may be gone from the robot: effects that may be smaller than the model's own.

Friction of a worn joint goes into the model; once the joint is mended, the model has too much of it. An effect cannot
be negative, but what is added to a model's own can, down to nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any

from diagnosis.decision_constants import CLEARLY_ORDINARY, ERROR_SCALES
from diagnosis.library import LibraryEffect, Location
from diagnosis.library.less import in_all
from spot_model.effects.base import Parameter
from spot_model.io.model_file import RobotModel


def with_repairs(library: Mapping[str, LibraryEffect], model: RobotModel) -> dict[str, LibraryEffect]:
    """The library, in which effects may take away what the model holds beyond ordinary errors."""
    return {name: _with_repair(entry, model) for name, entry in library.items()}


def _with_repair(entry: LibraryEffect, model: RobotModel) -> LibraryEffect:
    p = size_of(entry)
    if p is None or entry.coefficients[0].low != 0.0:
        return entry
    held = in_all(model, entry.effect, p)
    given = ERROR_SCALES.get(entry.name)
    if held.max() <= (0.0 if given is None else CLEARLY_ORDINARY * given.scales.get(p.name, 0.0)):
        return entry
    made = copy(entry)
    # Of this one alone: what the class says of the effect holds, but for this bound.
    own: Any = made
    own.coefficients = (replace(entry.coefficients[0], low=-float(held.max())),)
    own.taken_away = {p.name: p.null - float(held.max())}
    return made


def size_of(entry: LibraryEffect) -> Parameter | None:
    """The parameter of an effect that is local to joints and has one free number; None for others."""
    if entry.location is not Location.JOINT or len(entry.coefficients) != 1 or not entry.coefficients[0].is_free:
        return None
    return next((p for p in entry.effect.parameters() if p.name == entry.coefficients[0].name), None)
