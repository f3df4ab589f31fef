"""The body's velocity and the contacts against feet that stand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spot_model.robot.state import Array
from spot_runtime.control.safety.signals import bounds
from spot_runtime.control.safety.signals.legs import feet, sole_speeds_m_s
from spot_runtime.control.safety.signals.window import Window


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
    """Of the slowest foot in contact in the newest window."""

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
