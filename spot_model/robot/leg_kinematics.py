"""Leg kinematics: foot positions and Jacobians from joint angles, batched, for NumPy and torch."""

from __future__ import annotations

import functools
from typing import Any, Final

import numpy as np
from array_api_compat import device

from spot_model.robot import facts
from spot_model.robot.arrays import namespace_of
from spot_model.robot.facts import Array
from spot_model.robot.rotation import AnyArray

_HIP_X_M = [facts.end_sign(leg) * facts.HX_FROM_BODY_M[0] for leg in facts.LEG_NAMES]
_HIP_Y_M = [facts.side_sign(leg) * facts.HX_FROM_BODY_M[1] for leg in facts.LEG_NAMES]
_OUT_M = [facts.side_sign(leg) * facts.HY_FROM_HX_M[1] for leg in facts.LEG_NAMES]
_THIGH_X_M, _, _THIGH_Z_M = facts.KN_FROM_HY_M
_SHANK_X_M, _, _SHANK_Z_M = facts.FOOT_FROM_KN_M


def foot_position_in_body_m(position_rad: AnyArray) -> AnyArray:
    """Centres of the four foot spheres in the body frame.

    Args:
        position_rad: Joint positions. Shape (..., 12), canonical order, rad.

    Returns:
        Shape (..., 4, 3), legs fl, fr, hl, hr, m.
    """
    return foot_position_and_jacobian(position_rad)[0]


def foot_position_and_jacobian(position_rad: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Foot centres in the body frame, and their derivatives with respect to their own leg's three joints.

    Args:
        position_rad: Joint positions. Shape (..., 12), canonical order, rad.

    Returns:
        Positions, shape (..., 4, 3), m; Jacobians, shape (..., 4, 3, 3), m/rad, rows x, y, z, columns hx, hy, kn.
    """
    xp = namespace_of(position_rad)
    hip_x, hip_y, out = hip_placement(xp, position_rad.dtype, device(position_rad))
    hx, hy, kn = (position_rad[..., joint::3] for joint in range(3))
    cos_hx, sin_hx = xp.cos(hx), xp.sin(hx)
    # In the leg's plane: rotation about +y turns (x, z) into (x cos + z sin, −x sin + z cos).
    thigh_x, thigh_z = _turn(xp.cos(hy), xp.sin(hy), _THIGH_X_M, _THIGH_Z_M)
    shank_x, shank_z = _turn(xp.cos(hy + kn), xp.sin(hy + kn), _SHANK_X_M, _SHANK_Z_M)
    leg_x, leg_z = thigh_x + shank_x, thigh_z + shank_z

    y, z = out * cos_hx - leg_z * sin_hx, out * sin_hx + leg_z * cos_hx
    position = xp.stack([hip_x + leg_x, hip_y + y, z], axis=-1)
    by_hx = xp.stack([xp.zeros_like(z), -z, y], axis=-1)
    by_hy = xp.stack([leg_z, leg_x * sin_hx, -leg_x * cos_hx], axis=-1)
    by_kn = xp.stack([shank_z, shank_x * sin_hx, -shank_x * cos_hx], axis=-1)
    return position, xp.stack([by_hx, by_hy, by_kn], axis=-1)


@functools.lru_cache(maxsize=16)
def hip_placement(xp: Any, dtype: Any, on_device: Any) -> tuple[AnyArray, ...]:
    """Where the legs begin, x and y, and how far out, each of shape (4,), m; kept: a copy to a GPU makes one wait."""
    return tuple(xp.asarray(values, dtype=dtype, device=on_device) for values in (_HIP_X_M, _HIP_Y_M, _OUT_M))


def _turn(cos: AnyArray, sin: AnyArray, x_m: float, z_m: float) -> tuple[AnyArray, AnyArray]:
    return x_m * cos + z_m * sin, z_m * cos - x_m * sin


LONGEST_STEP_RAD: Final = 0.2


def joints_of_feet(feet_in_body_m: Array, near_rad: Array) -> Array:
    """Joint positions with the feet at given places, by Newton's method with bounded steps.

    Args:
        feet_in_body_m: Centres of the foot spheres in the body frame, shape (..., 4, 3), legs fl, fr, hl, hr, m.
        near_rad: Where to start, broadcast to shape (..., 12): of the two ways to bend a knee, the nearer is found.

    Returns:
        Shape (..., 12), canonical order, rad; joint stops are not looked at.

    Raises:
        ValueError: A foot cannot reach its place.
    """
    wanted = np.asarray(feet_in_body_m, dtype=np.float64)
    q = np.array(np.broadcast_to(near_rad, (*wanted.shape[:-2], facts.N_JOINTS)), dtype=np.float64)
    for _ in range(30):
        at, jacobian = foot_position_and_jacobian(q)
        left = wanted - np.asarray(at)
        if np.max(np.abs(left), initial=0.0) < 1e-6:
            return q
        step = np.linalg.solve(np.asarray(jacobian), left[..., None])[..., 0]
        q = q + np.clip(step, -LONGEST_STEP_RAD, LONGEST_STEP_RAD).reshape(q.shape)
    far_m = float(np.max(np.abs(wanted - np.asarray(foot_position_and_jacobian(q)[0]))))
    raise ValueError(f"a foot stays {far_m:.3f} m from where it should be; ask for less")
