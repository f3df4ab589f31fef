"""Measured signals, spoilt one at a time: every field of a state, in every way that a sensor or a cable fails."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import RobotState, SlowState

LATE_STATES: Final = 67
"""0.2 s."""

SPIKE_STATES: Final = 10
"""States from one spike to the next."""

PACKETS: Final = {
    "imu_acceleration": "acceleration_of_imu_in_link_m_s2",
    "imu_turn_rate": "angular_vel_of_link_in_link_rad_s",
    "imu_attitude": "odom_from_link_wxyz",
}
"""What each packet of the inertial unit holds."""

SLOW: Final = (
    "battery_charge_percent",
    "battery_voltage_v",
    "battery_current_a",
    "battery_temperature_c",
    "motor_temperature_c",
)
"""What is polled."""

SIGNALS: Final = (
    *PACKETS,
    *SLOW,
    "legs",
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
    earlier: np.ndarray
    """The value of 0.2 s ago."""
    seen: int
    """Number of states since it began."""
    noise: np.ndarray
    """White, of variance 1."""

    def one(self, what: Any, base: np.ndarray | None = None) -> np.ndarray:
        """The signal with one component exchanged."""
        spoilt = (self.now if base is None else base).copy()
        spoilt[self.which % len(spoilt)] = what
        return spoilt

    @property
    def component(self) -> float:
        """The component of now that is spoilt."""
        return float(self.now[self.which % len(self.now)])


WAYS: Final[dict[str, Callable[[Spoiling], np.ndarray]]] = {
    "frozen": lambda s: s.begun,
    "one frozen": lambda s: s.one(s.begun[s.which % len(s.begun)]),
    "all but one frozen": lambda s: s.one(s.component, s.begun),
    "zero": lambda s: s.now * 0,
    "one zero": lambda s: s.one(0),
    "offset": lambda s: s.one(s.component + s.size),
    "scaled": lambda s: s.now * s.size,
    "sign": lambda s: -s.now,
    "one sign": lambda s: s.one(-s.component),
    "exchanged": lambda s: np.roll(s.now, 1 + s.which % max(1, len(s.now) - 1)),
    "degrees": lambda s: np.degrees(s.now),
    "huge": lambda s: s.one(1e6 * s.size),
    "NaN": lambda s: s.one(np.nan),
    "late": lambda s: s.earlier,
    "one late": lambda s: s.one(s.earlier[s.which % len(s.now)]),
    "noisy": lambda s: s.now + s.size * s.noise,
    "spikes": lambda s: s.one(s.component + s.size) if s.seen % SPIKE_STATES == 0 else s.now,
    "neighbours exchanged": lambda s: _exchanged(s.now, s.which % len(s.now), (s.which + 1) % len(s.now)),
}


class SpoiltSignal:
    """Spoils one signal of every state that it is shown; ``legs`` are two that were taken for each other."""

    def __init__(self, signal: str, way: str, index: int, size: float) -> None:
        """Begin with the next state."""
        self._signal, self._way, self._index, self._size = signal, WAYS[way], index, size
        self._values: deque[np.ndarray] = deque(maxlen=LATE_STATES)
        self._begun: np.ndarray | None = None
        self._count = 0
        self._rng = np.random.default_rng(index)

    def __call__(self, state: RobotState) -> RobotState:
        """The state as it arrives."""
        self._count += 1
        if self._signal in SLOW:
            return state
        if self._signal == "legs":
            return _with_legs_exchanged(state, self._index)
        if self._signal in PACKETS:
            name = PACKETS[self._signal]
            packets = [replace(p, **{name: self._spoilt(np.asarray(getattr(p, name)))}) for p in state.imu]
            return replace(state, imu=tuple(packets))
        changed: Any = {self._signal: self._spoilt(np.asarray(getattr(state, self._signal)))}
        return replace(state, **changed)

    def slow(self, slow: SlowState) -> SlowState:
        """What was polled, as it arrives."""
        if self._signal not in SLOW:
            return slow
        self._count += 1
        now: Any = getattr(slow, self._signal)
        listed = list(now.values()) if isinstance(now, dict) else list(now) if isinstance(now, tuple) else [now]
        values = [float(value) for value in self._spoilt(np.array(listed))] if listed else []
        spoilt: Any = values[0] if isinstance(now, float) else tuple(values)
        changed: Any = {self._signal: dict(zip(now, values, strict=True)) if isinstance(now, dict) else spoilt}
        return replace(slow, **changed)

    def _spoilt(self, now: np.ndarray) -> Any:
        numbers = now.astype(np.float64)
        self._values.append(numbers)
        if self._begun is None:
            self._begun = numbers
        noise = self._rng.standard_normal(len(numbers))
        spoilt = self._way(Spoiling(numbers, self._begun, self._index, self._size, self._values[0], self._count, noise))
        return np.nan_to_num(spoilt) > 0.5 if now.dtype == np.bool_ else spoilt


def _with_legs_exchanged(state: RobotState, which: int) -> RobotState:
    legs = list(range(facts.N_LEGS))
    a, b = which % facts.N_LEGS, (which + 1 + which // facts.N_LEGS) % facts.N_LEGS
    legs[a], legs[b] = legs[b], legs[a]
    joints = np.arange(facts.N_JOINTS).reshape(facts.N_LEGS, -1)[legs].ravel()
    return replace(
        state,
        position_rad=state.position_rad[joints],
        velocity_rad_s=state.velocity_rad_s[joints],
        load_nm=state.load_nm[joints],
        foot_contact=state.foot_contact[legs],
    )


def _exchanged(values: np.ndarray, a: int, b: int) -> np.ndarray:
    spoilt = values.copy()
    spoilt[[a, b]] = values[[b, a]]
    return spoilt
