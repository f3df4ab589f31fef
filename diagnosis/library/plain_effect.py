"""A library entry for any effect of the torque, without a word about it: what an effect says of itself is enough."""

from __future__ import annotations

import itertools
import math
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels.channel_view import Array, Flags, Shape, Views
from diagnosis.channels.drive.nominal_torque import torque_after_nm
from diagnosis.library.base import ALL_OF_IT, Coefficient, LibraryEffect
from spot_model.effects.base import Effect, Parameter, TorqueEffect
from spot_model.errors import BadInputError
from spot_model.plant.joint_losses import has_joint_loss

COARSE: Final = 5
"""Values of a shape parameter that are tried first, evenly over its bounds."""
FINER: Final = (1 / 8, 1 / 24, 1 / 72)
"""Steps of the search around the best of them, in shares of the bounds' distance."""
MAX_SHAPES: Final = 125
WIDEST: Final = 1e4
"""Bounds farther apart than this cannot be searched evenly."""


def entry_of(effect: type[Effect]) -> LibraryEffect:
    """An entry whose coefficients and shape are the effect's parameters.

    A parameter that alone, the others at their null values, changes the torque in proportion to itself is a
    coefficient; any other is searched over its bounds.

    Raises:
        BadInputError: The effect changes no torque between set-point and load, or has nothing to fit.
    """
    if not (issubclass(effect, TorqueEffect) or has_joint_loss(effect())):
        raise BadInputError(
            f"effect {effect.name} changes no torque between set-point and load; write a LibraryEffect with its columns"
        )
    sizes = tuple(p for p in effect.parameters() if _is_size(effect, p))
    shape = tuple(p for p in effect.parameters() if p not in sizes)
    for p in shape:
        if not 0.0 < p.high - p.low < WIDEST:
            raise BadInputError(
                f"{effect.name}.{p.name} cannot be searched from {p.low:g} to {p.high:g}; bound it closer"
            )
    if not sizes and not shape:
        raise BadInputError(f"effect {effect.name} has no parameter to fit; give it one with parameter(...)")
    coefficients = tuple(Coefficient(p.name, p.unit, p.low - p.null, p.high - p.null) for p in sizes) or (ALL_OF_IT,)
    made: type[LibraryEffect] = type(
        f"{effect.__name__}Entry",
        (_PlainEntry,),
        {"__doc__": effect.__doc__, "effect": effect, "coefficients": coefficients, "searched": shape},
    )
    return made()


class _PlainEntry(LibraryEffect):
    searched: ClassVar[tuple[Parameter, ...]]

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """An even grid over the bounds."""
        per = max(2, min(COARSE, int(MAX_SHAPES ** (1 / max(1, len(self.searched))))))
        grids = [np.linspace(p.low, p.high, per).tolist() for p in self.searched]
        return tuple(dict(zip((p.name for p in self.searched), at, strict=True)) for at in itertools.product(*grids))

    def neighbours(self, shape: Shape) -> tuple[Shape, ...]:
        """One parameter changed at a time, by steps of several sizes."""
        return tuple(
            {**shape, p.name: shape[p.name] + sign * share * (p.high - p.low)}
            for p in self.searched
            for share in FINER
            for sign in (-1.0, 1.0)
        )


def _is_size(effect: type[Effect], p: Parameter) -> bool:
    """Whether the parameter alone changes a torque in proportion to how far it is from its null value."""
    if not math.isfinite(p.null):
        return False
    if not issubclass(effect, TorqueEffect):
        return True
    rng = np.random.default_rng(0)
    torque, position, velocity = (size * rng.standard_normal((64, 12)) for size in (20.0, 1.0, 5.0))
    one_run = np.zeros(len(torque), dtype=np.intp)
    step = 0.01 * ((p.high if math.isfinite(p.high) else 1.0) - p.null or p.low - p.null)

    def added(share: float) -> Array:
        moved = effect(joints=("all",), **{p.name: p.null + share * step})
        return torque_after_nm(moved, torque, position, velocity, one_run, 0.003) - torque

    one, two = added(0.5), added(1.0)
    return bool(np.any(two) and np.allclose(two, 2.0 * one, atol=1e-6 * np.max(np.abs(two))))
