"""How high the body is over its feet, from joints and attitude: the estimator's z is not a height over ground.

Pure Python on purpose: for one pose it is several times faster than arrays, and it runs on each state.
"""

from __future__ import annotations

import math
from typing import Final

from spot_model.robot import facts
from spot_model.robot.state import Array

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
    """Whether the body's origin is at least so far above the sole of its lowest foot.

    Args:
        bound_m: Height, m.
        position_rad: Joint positions, shape (12,), canonical order.
        world_from_body_wxyz: The body's attitude, unit quaternion, shape (4,).
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
