"""Loads against the weight that the legs carry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.window import Window

_NO_LEGS = np.zeros(facts.N_LEGS)


class WeightMemory(NamedTuple):
    """What the legs of a robot that walks have carried of late."""

    pushed_n_s: Array = _NO_LEGS
    """Upward impulse of the ground on each foot, by the loads; it fades. Shape (4,)."""
    gained_n_s: float = 0.0
    """Upward momentum that the robot gained; it fades."""
    felt_s: float = 0.0
    """Time of both."""

    @property
    def legs_share(self) -> Array:
        """Mean force of the ground on each foot as a share of the robot's weight; NaN until enough is known."""
        if self.felt_s < bounds.WEIGHT_LEAST_S:
            return np.full(facts.N_LEGS, np.nan)
        share: Array = self.pushed_n_s / (bounds.WEIGHT_N * self.felt_s)
        return share

    @property
    def is_wrong(self) -> bool:
        """Whether a foot seems to pull at the ground, or the loads not to carry the robot."""
        legs = self.legs_share
        carried = float(legs.sum()) - self.gained_n_s / (bounds.WEIGHT_N * max(self.felt_s, bounds.WEIGHT_LEAST_S))
        is_pulling = bool((legs < -bounds.PULL_SHARE).any())
        return is_pulling or carried < bounds.CARRIED_LEAST or carried > bounds.CARRIED_MOST


def after_window(memory: WeightMemory, window: Window, carried_n: Array) -> WeightMemory:
    """The memory after one more window, of a robot that stands on its legs or jumps, but is not held.

    ``carried_n`` is the upward force of the ground on each foot. Shape (4,).
    """
    first, last = window.first, window.last
    fade = max(0.0, 1.0 - window.duration_s / bounds.WEIGHT_MEMORY_S)
    risen_m_s = float(last.linear_vel_of_body_in_odom_m_s[2] - first.linear_vel_of_body_in_odom_m_s[2])
    return WeightMemory(
        memory.pushed_n_s * fade + carried_n * window.duration_s,
        memory.gained_n_s * fade + facts.TOTAL_MASS_KG * risen_m_s,
        memory.felt_s * fade + window.duration_s,
    )
