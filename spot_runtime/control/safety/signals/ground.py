"""What the ground says: standing feet against the body's velocity and contacts, its forces against the weight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.legs import feet, sole_speeds_m_s
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


def after_weight_window(memory: WeightMemory, window: Window, carried_n: Array) -> WeightMemory:
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


class GroundMemory(NamedTuple):
    """What the feet did recently."""

    touching_s: float = 0.0
    """Time with any foot in contact, which fades."""
    sliding_s: float = 0.0
    """Of it, time in which none of the feet that carried something stood."""
    unloaded_s: float = 0.0
    """Of it, time in which none of the feet in contact carried anything."""
    travel_m: float = 0.0
    """Path of the body since a foot last touched down or lifted off, while any touches. It fades, so that the noise of
    a velocity near zero does not add up."""
    slid_m: float = 0.0
    """Path meanwhile of whichever of the four feet moved least over the ground, in contact or not; it fades alike."""
    airborne_s: float = 0.0
    """Time without any foot in contact."""
    has_touched: bool = False
    """Whether any foot ever was in contact; where none ever is, contacts are not reported at all."""
    speed_m_s: float = 0.0
    """Speed of the slowest foot in contact in the newest window."""

    @property
    def sliding_share(self) -> float:
        """Share of the time with contact in which no foot stood; 0 until enough is known."""
        return self._share(self.sliding_s)

    @property
    def unloaded_share(self) -> float:
        """Share of the time with contact in which no foot in contact carried anything; 0 until enough is known."""
        return self._share(self.unloaded_s)

    def _share(self, seconds: float) -> float:
        return seconds / self.touching_s if self.touching_s >= 0.5 * bounds.FOOT_MEMORY_S else 0.0


def after_window(memory: GroundMemory, window: Window, carried_n: Array | None) -> GroundMemory:
    """The memory after one more window; ``carried_n`` is the upward force on each foot, None where it is not known."""
    state, body_from_odom = window.last, window.odom_from_body.T
    velocity = body_from_odom @ state.linear_vel_of_body_in_odom_m_s
    speed = float(np.sqrt(velocity @ velocity))
    is_touching = bool(state.foot_contact.any())
    is_same = is_touching and not window.contact_changed
    fade = max(0.0, 1.0 - window.duration_s / bounds.TRAVEL_MEMORY_S)
    travel = memory.travel_m * fade + speed * window.duration_s if is_same else 0.0
    soles = sole_speeds_m_s(
        feet(state.position_rad, state.velocity_rad_s),
        velocity_m_s=velocity,
        turn_rate_rad_s=body_from_odom @ state.angular_vel_of_body_in_odom_rad_s,
        up=body_from_odom[:, 2],
    )
    slid = memory.slid_m * fade + float(soles.min()) * window.duration_s if is_same else 0.0
    airborne = 0.0 if is_touching else memory.airborne_s + window.duration_s
    fade = max(0.0, 1.0 - window.duration_s / bounds.FOOT_MEMORY_S)
    touching, sliding, unloaded = memory.touching_s * fade, memory.sliding_s * fade, memory.unloaded_s * fade
    slowest = 0.0
    # A foot that touched throughout: at touch-down and lift-off it moves.
    contacts = state.foot_contact & window.first.foot_contact
    if contacts.any():
        touching += window.duration_s
        if carried_n is not None:
            contacts = contacts & (carried_n > bounds.FOOT_LEAST_SHARE * bounds.WEIGHT_N)
            unloaded += 0.0 if contacts.any() else window.duration_s
    if contacts.any():
        slowest = float(soles[contacts].min())
        if slowest > bounds.FOOT_SPEED_M_S + bounds.FOOT_SPEED_SHARE * speed:
            sliding += window.duration_s
    return GroundMemory(touching, sliding, unloaded, travel, slid, airborne, memory.has_touched or is_touching, slowest)
