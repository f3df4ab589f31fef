"""What a policy's contract may ask of the joints."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from spot_model.policy.contract import PolicyContract
from spot_model.robot.rotation import LEVEL_WXYZ
from spot_runtime.control.safety.body_height import body_height_m
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason


def check_policy(contract: PolicyContract, default_position_rad: np.ndarray, limits: SafetyLimits) -> Stop | None:
    """A stop if a contract asks for more than the limits allow.

    Args:
        contract: Of the policy.
        default_position_rad: Its default pose, canonical order. Shape (12,).
        limits: The bounds.
    """
    wrong = [f"{name} = {value:g}, allowed: {allowed}" for name, value, allowed in _wrong(contract, limits)]
    height_m = body_height_m(default_position_rad, LEVEL_WXYZ)
    if height_m < limits.body_height_m:
        wrong.append(f"body height in the default pose = {height_m:.3f} m, allowed: from {limits.body_height_m:g}")
    return Stop(StopReason.POLICY_OUT_OF_BOUNDS, "; ".join(wrong)) if wrong else None


def _wrong(contract: PolicyContract, limits: SafetyLimits) -> Iterator[tuple[str, float, str]]:
    kp, kd = max(contract.kp_nm_per_rad), max(contract.kd_nm_s_per_rad)
    torque_nm = kp * contract.action_scale_rad
    for name, value, bound in (
        ("kp_nm_per_rad", kp, limits.policy_kp_nm_per_rad),
        ("kd_nm_s_per_rad", kd, limits.policy_kd_nm_s_per_rad),
        ("action_scale_rad", contract.action_scale_rad, limits.policy_action_scale_rad),
        ("torque of a unit action, N·m", torque_nm, limits.policy_action_torque_nm),
    ):
        if value > bound:
            yield name, value, f"up to {bound:g}"
    low, high = limits.policy_rate_hz
    if not low <= contract.rate_hz <= high:
        yield "rate_hz", contract.rate_hz, f"{low:g} to {high:g}"


def with_speed_limit(limits: SafetyLimits, rate_hz: float, own_rad_s: float = math.inf) -> SafetyLimits:
    """The limits with a step of the set-point that also keeps its speed at this rate within bounds, and its own one."""
    step_rad = min(limits.setpoint_step_rad, limits.setpoint_speed_rad_s / rate_hz, own_rad_s / rate_hz)
    return limits.model_copy(update={"setpoint_step_rad": step_rad})
