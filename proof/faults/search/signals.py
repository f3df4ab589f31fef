"""Measured signals, spoilt one at a time: every field of a state, in every way that a sensor or a cable fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from spot_model.robot.state import RobotState

SIGNALS: Final = (
    "position_rad",
    "velocity_rad_s",
    "load_nm",
    "odom_from_body_wxyz",
    "linear_vel_of_body_in_odom_m_s",
    "angular_vel_of_body_in_odom_rad_s",
    "foot_contact",
    "position_of_body_in_odom_m",
)


class Spoiling(NamedTuple):
    """What a way of failing sees of a signal."""

    now: np.ndarray
    begun: np.ndarray
    """The value when it began."""
    which: int
    size: float

    def one(self, what: Any, base: np.ndarray | None = None) -> np.ndarray:
        """The signal with one component exchanged."""
        spoilt = (self.now if base is None else base).copy()
        spoilt[self.which % len(spoilt)] = what
        return spoilt

    @property
    def component(self) -> float:
        """The component of now that is spoilt."""
        return float(self.now[self.which % len(self.now)])


_WAYS: Final[dict[str, Callable[[Spoiling], np.ndarray]]] = {
    "frozen": lambda s: s.begun,
    "one frozen": lambda s: s.one(s.begun[s.which % len(s.begun)]),
    "all but one frozen": lambda s: s.one(s.component, s.begun),
    "zero": lambda s: s.now * 0,
    "one zero": lambda s: s.one(0),
    "offset": lambda s: s.one(s.component + s.size),
    "scaled": lambda s: s.now * s.size,
    "sign": lambda s: -s.now,
    "one sign": lambda s: s.one(-s.component),
    "exchanged": lambda s: np.roll(s.now, 1 + s.which % (len(s.now) - 1)),
    "degrees": lambda s: np.degrees(s.now),
    "huge": lambda s: s.one(1e6 * s.size),
    "NaN": lambda s: s.one(np.nan),
}
KINDS: Final = tuple(_WAYS)


class SpoiltSignal:
    """Spoils one signal of every state that it is shown."""

    def __init__(self, signal: str, way: str, index: int, size: float) -> None:
        """Begin with the next state."""
        self._signal, self._way, self._index, self._size = signal, _WAYS[way], index, size
        self._begun: np.ndarray | None = None

    def __call__(self, state: RobotState) -> RobotState:
        """The state as it arrives."""
        now = np.asarray(getattr(state, self._signal))
        if self._begun is None:
            self._begun = now.copy()
        numbers = now.astype(np.float64)
        spoilt = self._way(Spoiling(numbers, self._begun.astype(np.float64), self._index, self._size))
        if now.dtype == np.bool_:
            spoilt = np.nan_to_num(spoilt) > 0.5
        changed: dict[str, Any] = {self._signal: spoilt}
        return replace(state, **changed)
