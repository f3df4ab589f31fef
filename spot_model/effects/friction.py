"""The direction of dry friction."""

from __future__ import annotations

from typing import Any, Final

from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray

STICK_SPEED_RAD_S: Final = 0.1
"""Below this speed the sign of the velocity is smoothed, so that a still joint is not shaken."""


def smooth_sign(velocity_rad_s: AnyArray, speed_rad_s: float = STICK_SPEED_RAD_S) -> AnyArray:
    """Sign of a velocity, smooth over ``speed_rad_s`` about zero; any shape."""
    return namespace_of(velocity_rad_s).tanh(velocity_rad_s / speed_rad_s)


def built_up(direction: AnyArray, velocity_rad_s: AnyArray, dt_s: float, distance_rad: Any) -> AnyArray:
    """Direction of dry friction after one more step; it builds up over a distance after a reversal, and holds at rest.

    Exact for a velocity that is constant over the step. Source: Dahl 1968.

    Args:
        direction: Before the step, -1 to 1.
        velocity_rad_s: Same shape.
        dt_s: Length of the step.
        distance_rad: Over which a contact that sticks gives way, > 0.
    """
    xp = namespace_of(velocity_rad_s)
    towards = xp.sign(velocity_rad_s)
    return towards + (direction - towards) * xp.exp(-xp.abs(velocity_rad_s) * dt_s / distance_rad)
