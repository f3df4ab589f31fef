"""Effects that are switched on and off while a robot walks, each with a size."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from spot_model.effects.base import Effect, Parameter
from spot_model.effects.bodies import PayloadMass
from spot_model.effects.drivetrain import Backlash, TorqueGain
from spot_model.effects.friction import CoulombFriction


@dataclass(frozen=True)
class Switch:
    """One effect to switch on and off."""

    words: str
    """What it is."""
    size_words: str
    """What its size is, with its unit."""
    effect: Effect
    """As it acts when it is switched on."""
    sized: str
    """The parameter that the slider changes."""

    @property
    def parameter(self) -> Parameter:
        """That parameter, with its bounds and unit."""
        return next(p for p in self.effect.parameters() if p.name == self.sized)

    @property
    def size(self) -> float:
        """Its value when the effect is switched on."""
        return float(getattr(self.effect, self.sized))

    @property
    def bounds(self) -> tuple[float, float]:
        """What the slider allows: from no effect to the parameter's bound on the side of :attr:`size`."""
        p = self.parameter
        return (p.null, p.high) if self.size > p.null else (p.low, p.null)

    @property
    def step(self) -> float:
        """Of the slider: a power of ten, a fiftieth of its range at most."""
        low, high = self.bounds
        return float(10.0 ** math.floor(math.log10((high - low) / 50.0)))

    def of_size(self, size: float) -> Effect:
        """The effect with another size, within :attr:`bounds`."""
        low, high = self.bounds
        changed: dict[str, Any] = {self.sized: min(max(size, low), high)}
        return dataclasses.replace(self.effect, **changed)


BUILT_IN: Final = (
    Switch("friction in all knees", "N·m", CoulombFriction(joints=("knees",), level_nm=3.0), "level_nm"),
    Switch("weak front left knee", "share of its torque", TorqueGain(joints=("fl_kn",), gain=0.5), "gain"),
    Switch("backlash in all joints", "rad", Backlash(gap_rad=0.02), "gap_rad"),
    Switch("payload on the back", "kg", PayloadMass(mass_kg=8.0, z_m=0.15), "mass_kg"),
)
"""What is offered without a diagnosis."""


class Switched:
    """Which effects act beside a model's own; an effect stays the same object until its size changes."""

    def __init__(self, own: Iterable[Effect]) -> None:
        self._own = tuple(own)
        self._on: dict[Switch, Effect] = {}

    def turn(self, switch: Switch, size: float | None) -> bool:
        """Switch an effect on with a size, or off with None; say whether anything changed."""
        before = self._on.get(switch)
        if size is None:
            return self._on.pop(switch, None) is not None
        effect = switch.of_size(size)
        if before is not None and getattr(before, switch.sized) == getattr(effect, switch.sized):
            return False
        self._on[switch] = effect
        return True

    @property
    def effects(self) -> tuple[Effect, ...]:
        """All that act, in the order in which they act."""
        return (*self._own, *self._on.values())
