"""Velocity commands from a gamepad, up to the policy's own range."""

from __future__ import annotations

import numpy as np

from spot_model.policy.contract import PolicyContract
from spot_model.robot.facts import Array
from spot_runtime.config import OperatorConfig
from spot_runtime.sources.gamepad import GamepadSource, Pad
from trainer.play.walk import VelocityAt

MOST: float = 5.0
"""What a stick at its end may ask for at most (m/s, rad/s), as for a robot."""


def stick_steering(contract: PolicyContract, pad: Pad) -> VelocityAt:
    """Follow the sticks while the dead-man button is held, as ``spot-rl run --gamepad`` does."""
    low, high = np.array(contract.velocity_command_low), np.array(contract.velocity_command_high)
    v_x, v_y, yaw_rate = np.clip(high, 0.01, MOST)
    source = GamepadSource(OperatorConfig(top_v_x_m_s=v_x, top_v_y_m_s=v_y, top_yaw_rate_rad_s=yaw_rate), pad)

    def velocity_at(time_s: float) -> Array:
        return np.clip(source.sample(time_s, round(time_s * 1e9)).command, low, high)

    return velocity_at
