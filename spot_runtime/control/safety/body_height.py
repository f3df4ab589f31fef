"""How high the body is over its feet, and whether a policy's default pose respects that and the safety limits.

The height comes from joints and attitude, because the estimator's z is not a height over ground. Pure Python on
purpose: for one pose it is several times faster than arrays, and it runs on each state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from spot_model.policy.contract import PolicyContract
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import LEVEL_WXYZ
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason

_HIPS_M: Final = tuple(
    (facts.end_sign(leg) * facts.HX_FROM_BODY_M[0], facts.side_sign(leg) * facts.HX_FROM_BODY_M[1])
    for leg in facts.LEG_NAMES
)
_OUT_M: Final = tuple(facts.side_sign(leg) * facts.HY_FROM_HX_M[1] for leg in facts.LEG_NAMES)
_LEGS: Final = tuple(range(facts.N_LEGS))
_THIGH_X_M, _, _THIGH_Z_M = facts.KN_FROM_HY_M
_SHANK_Z_M: Final = facts.FOOT_FROM_KN_M[2]
_FOOT_RADIUS_M: Final = facts.FOOT_RADIUS_M


def is_body_above(bound_m: float, position_rad: Array, world_from_body_wxyz: Array) -> bool:
    """Whether the body's origin is at least ``bound_m`` above the sole of its lowest foot.

    Joint positions have shape (12,), canonical order; the attitude is a unit quaternion, shape (4,).
    """
    joints, up = position_rad.tolist(), _up_in_body(world_from_body_wxyz)
    # One leg that reaches far enough down is an answer, and nearly always the first one does.
    return any(_height_over_sole_m(leg, joints, up) >= bound_m for leg in _LEGS)


def body_height_m(position_rad: Array, world_from_body_wxyz: Array) -> float:
    """Height of the body's origin over the sole of the lowest foot, m; arguments as in :func:`is_body_above`."""
    joints, up = position_rad.tolist(), _up_in_body(world_from_body_wxyz)
    return max(_height_over_sole_m(leg, joints, up) for leg in _LEGS)


def _up_in_body(wxyz: Array) -> tuple[float, float, float]:
    """The world's upward direction, in the body's frame."""
    w, x, y, z = wxyz.tolist()
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def _height_over_sole_m(leg: int, joints: list[float], up: tuple[float, float, float]) -> float:
    hx, hy, kn = joints[3 * leg : 3 * leg + 3]
    # In the leg's plane: rotation about +y turns (x, z) into (x cos + z sin, −x sin + z cos).
    cos_hy, sin_hy = math.cos(hy), math.sin(hy)
    leg_x = _THIGH_X_M * cos_hy + _THIGH_Z_M * sin_hy + _SHANK_Z_M * math.sin(hy + kn)
    leg_z = _THIGH_Z_M * cos_hy - _THIGH_X_M * sin_hy + _SHANK_Z_M * math.cos(hy + kn)
    cos_hx, sin_hx = math.cos(hx), math.sin(hx)
    (hip_x, hip_y), out = _HIPS_M[leg], _OUT_M[leg]
    up_x, up_y, up_z = up
    foot_x, foot_y = hip_x + leg_x, hip_y + out * cos_hx - leg_z * sin_hx
    return _FOOT_RADIUS_M - (up_x * foot_x + up_y * foot_y + up_z * (out * sin_hx + leg_z * cos_hx))


def check_policy(contract: PolicyContract, default_position_rad: np.ndarray, limits: SafetyLimits) -> Stop | None:
    """A stop if a contract asks for more than the limits allow; its default pose has shape (12,), canonical order."""
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
