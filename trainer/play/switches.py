"""Effects that are switched on and off while a robot walks."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

from spot_model.effects.base import Effect, Parameter
from spot_model.effects.bodies import PayloadMass
from spot_model.effects.drivetrain import Backlash, TorqueGain
from spot_model.effects.friction import CoulombFriction

Effects = tuple[Effect, ...]
Change = Callable[[Effects], Effects]
"""What switching something on does to the effects of a robot."""


class Slider(NamedTuple):
    """How large an effect may be."""

    words: str
    low: float
    high: float
    step: float
    start: float


class Switch(Protocol):
    """Something that can be switched on."""

    @property
    def words(self) -> str:
        """What it is."""
        ...

    @property
    def slider(self) -> Slider | None:
        """Its sizes; None where it has only one."""
        ...

    def change(self, size: float) -> Change:
        """What it does when it is switched on with a size."""
        ...


@dataclass(frozen=True)
class Sized:
    """One effect, of which a slider changes one parameter."""

    words: str
    size_words: str
    """What the slider changes, with its unit."""
    effect: Effect
    """As it acts when it is first switched on."""
    sized: str
    """Name of that parameter."""

    @property
    def parameter(self) -> Parameter:
        """That parameter, with its bounds."""
        return next(p for p in self.effect.parameters() if p.name == self.sized)

    @property
    def slider(self) -> Slider:
        """From no effect to the parameter's bound on the side of its value; the step is at most a fiftieth of that."""
        p, start = self.parameter, float(getattr(self.effect, self.sized))
        low, high = (p.null, p.high) if start > p.null else (p.low, p.null)
        return Slider(self.size_words, low, high, float(10.0 ** math.floor(math.log10((high - low) / 50.0))), start)

    def change(self, size: float) -> Change:
        """Add the effect; a size beyond the slider's ends is cut to them."""
        _, low, high, *_ = self.slider
        changed: dict[str, Any] = {self.sized: min(max(size, low), high)}
        effect = dataclasses.replace(self.effect, **changed)
        return lambda effects: (*effects, effect)


@dataclass(frozen=True)
class Found:
    """What a diagnosis found, at the size that it found."""

    words: str
    add: Change
    slider: None = None

    def change(self, size: float) -> Change:
        """Add what was found."""
        return self.add


BUILT_IN: Final = (
    Sized("friction in all knees", "size (N·m)", CoulombFriction(joints=("knees",), level_nm=3.0), "level_nm"),
    Sized("weak front left knee", "share of its torque", TorqueGain(joints=("fl_kn",), gain=0.5), "gain"),
    Sized("backlash in all joints", "size (rad)", Backlash(gap_rad=0.02), "gap_rad"),
    Sized("payload on the back", "size (kg)", PayloadMass(mass_kg=8.0, z_m=0.15), "mass_kg"),
)
"""What is offered without a diagnosis."""


class Switched:
    """Which effects act: a model's own, and those switched on, each the same object until its size changes."""

    def __init__(self, own: Iterable[Effect]) -> None:
        self._own = tuple(own)
        self._on: dict[Switch, tuple[float, Change]] = {}

    def turn(self, switch: Switch, size: float | None) -> bool:
        """Switch something on with a size, or off with None; say whether anything changed."""
        if size is None:
            return self._on.pop(switch, None) is not None
        if switch in self._on and self._on[switch][0] == size:
            return False
        self._on[switch] = (size, switch.change(size))
        return True

    @property
    def words(self) -> str:
        """What is switched on; empty where nothing is."""
        return ", ".join(switch.words for switch in self._on)

    @property
    def effects(self) -> Effects:
        """All that act, in the order in which they act."""
        effects = self._own
        for _, change in self._on.values():
            effects = change(effects)
        return effects
