"""The direction of dry friction, and the total torque loss of a model's joints."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from array_api_compat import array_namespace
from numpy.typing import NDArray

from spot_model.effects.base import Effect, LossMotion, ModelEffect
from spot_model.robot.rotation import AnyArray

STICK_SPEED_RAD_S: Final = 0.1
"""Below this speed the sign of the velocity is smoothed, so that a still joint is not shaken."""


def smooth_sign(velocity_rad_s: AnyArray, speed_rad_s: float = STICK_SPEED_RAD_S) -> AnyArray:
    """Sign of a velocity, smooth over ``speed_rad_s`` about zero; any shape."""
    return array_namespace(velocity_rad_s).tanh(velocity_rad_s / speed_rad_s)


def joint_losses_nm(effects: Iterable[Effect], motion: LossMotion) -> NDArray[np.float64]:
    """Torque that all effects together take away between motor and load cell, shape (n, 12), N·m."""
    total = np.zeros_like(motion.velocity_rad_s, dtype=np.float64)
    for effect in effects:
        if isinstance(effect, ModelEffect):
            total = total + effect.joint_loss_nm(motion)
    return total


def has_joint_loss(effect: Effect) -> bool:
    """Whether an effect's class defines a torque loss between motor and load cell."""
    return isinstance(effect, ModelEffect) and type(effect).joint_loss_nm is not ModelEffect.joint_loss_nm
