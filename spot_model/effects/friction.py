"""The direction of dry friction."""

from __future__ import annotations

from typing import Final

from array_api_compat import array_namespace

from spot_model.robot.rotation import AnyArray

STICK_SPEED_RAD_S: Final = 0.1
"""Below this speed the sign of the velocity is smoothed, so that a still joint is not shaken."""


def smooth_sign(velocity_rad_s: AnyArray, speed_rad_s: float = STICK_SPEED_RAD_S) -> AnyArray:
    """Sign of a velocity, smooth over ``speed_rad_s`` about zero; any shape."""
    return array_namespace(velocity_rad_s).tanh(velocity_rad_s / speed_rad_s)
