"""Which set-point each mode asks for: one pure function."""

from __future__ import annotations

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import Array, Gains
from spot_runtime.config import HandoverConfig
from spot_runtime.control.handover import (
    Setpoint,
    blend,
    damping_setpoint,
    hold_weight_in,
    hold_weight_out,
    policy_setpoint,
)
from spot_runtime.control.modes import Mode


def within_stops(position_rad: Array) -> Array:
    """A measured pose as a set-point: sensors may read a little beyond a joint's stop. Shape (12,)."""
    return np.minimum(np.maximum(position_rad, facts.POSITION_LOW_RAD), facts.POSITION_HIGH_RAD)


def asked_setpoint(
    mode: Mode,
    in_mode_s: float,
    *,
    hold: Setpoint,
    policy_rad: Array | None,
    policy_gains: Gains,
    measured_rad: Array,
    config: HandoverConfig,
) -> Setpoint:
    """The set-point that a mode asks for, before any limit.

    Args:
        mode: One that sends.
        in_mode_s: Robot time since it began.
        hold: The pose in which the vendor's stand handed over.
        policy_rad: The policy's set-point of this tick, shape (12,); None in modes that run no policy.
        policy_gains: The policy's gains.
        measured_rad: The newest measured pose, shape (12,).
        config: The ramps.

    Raises:
        ValueError: The mode runs the policy, but there is no set-point of it.
    """
    if mode is Mode.DAMPING:
        return damping_setpoint(within_stops(measured_rad), config.damping_kd_nm_s_per_rad)
    if not mode.runs_policy:
        return hold
    if policy_rad is None:
        raise ValueError(f"mode {mode.value} needs the policy's set-point")
    weight = 0.0
    if mode is Mode.RAMPING_IN:
        weight = hold_weight_in(in_mode_s / config.ramp_in_s)
    elif mode is Mode.RAMPING_OUT:
        weight = hold_weight_out(in_mode_s / config.ramp_out_s)
    return blend(hold, policy_setpoint(policy_rad, policy_gains), weight)
