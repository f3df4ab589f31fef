"""Where the feet are and how they move, from joints alone."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from spot_model.robot import facts
from spot_model.robot.state import Array

_HIPS_M: Final = np.array(
    [
        [facts.end_sign(leg) * facts.HX_FROM_BODY_M[0], facts.side_sign(leg) * facts.HX_FROM_BODY_M[1], 0.0]
        for leg in facts.LEG_NAMES
    ]
)
_OUT_M: Final = np.array([facts.side_sign(leg) * facts.HY_FROM_HX_M[1] for leg in facts.LEG_NAMES])
_THIGH_X_M, _, _THIGH_Z_M = facts.KN_FROM_HY_M
_SHANK_Z_M: Final = facts.FOOT_FROM_KN_M[2]


class Feet(NamedTuple):
    """The four feet in the body's frame, legs fl, fr, hl, hr."""

    position_m: Array
    """Centres of the feet from the body's origin. Shape (4, 3)."""
    velocity_m_s: Array
    """Of those centres relative to the body. Shape (4, 3)."""
    turn_rate_rad_s: Array
    """Of the lower legs relative to the body. Shape (4, 3)."""


def feet(position_rad: Array, velocity_rad_s: Array) -> Feet:
    """Forward kinematics of positions and velocities.

    A leg turns by hx about x at its hip, by hy about y at the upper leg's end, and by kn about y at the knee.

    Args:
        position_rad: Joint positions, shape (12,), canonical order.
        velocity_rad_s: Joint velocities, as above.
    """
    hx, hy, kn = position_rad.reshape(4, 3).T
    hx_rate, hy_rate, kn_rate = velocity_rad_s.reshape(4, 3).T
    shank, shank_rate = hy + kn, hy_rate + kn_rate
    sin_hy, cos_hy, sin_shank, cos_shank = np.sin(hy), np.cos(hy), np.sin(shank), np.cos(shank)
    # In the leg's plane, from the hy joint; x forward, z along the leg.
    x = _THIGH_X_M * cos_hy + _THIGH_Z_M * sin_hy + _SHANK_Z_M * sin_shank
    z = _THIGH_Z_M * cos_hy - _THIGH_X_M * sin_hy + _SHANK_Z_M * cos_shank
    x_rate = (_THIGH_Z_M * cos_hy - _THIGH_X_M * sin_hy) * hy_rate + _SHANK_Z_M * cos_shank * shank_rate
    z_rate = -(_THIGH_Z_M * sin_hy + _THIGH_X_M * cos_hy) * hy_rate - _SHANK_Z_M * sin_shank * shank_rate
    sin_hx, cos_hx = np.sin(hx), np.cos(hx)
    y, down = _OUT_M * cos_hx - z * sin_hx, _OUT_M * sin_hx + z * cos_hx
    position = np.stack([x, y, down], axis=1) + _HIPS_M
    velocity = np.stack([x_rate, -down * hx_rate - z_rate * sin_hx, y * hx_rate + z_rate * cos_hx], axis=1)
    turn_rate = np.stack([hx_rate, shank_rate * cos_hx, shank_rate * sin_hx], axis=1)
    return Feet(position, velocity, turn_rate)


def ground_forces_n(position_rad: Array, load_nm: Array) -> Array:
    """The forces of the ground on the feet that these loads balance, in the body's frame; shape (4, 3), N.

    The legs' own weight is left out.

    For each leg, load = -Jᵀ·force, with J the foot's Jacobian in the body's frame.

    Args:
        position_rad: Joint positions, shape (12,), canonical order.
        load_nm: Measured loads, as above.
    """
    columns = [feet(position_rad, np.tile(unit, facts.N_LEGS)).velocity_m_s for unit in np.eye(3)]
    jacobians = np.stack(columns, axis=2)
    forces = np.linalg.solve(jacobians.transpose(0, 2, 1), load_nm.reshape(facts.N_LEGS, 3, 1))[..., 0]
    return np.asarray(-forces, dtype=np.float64)


def sole_speeds_m_s(state_feet: Feet, *, velocity_m_s: Array, turn_rate_rad_s: Array, up: Array) -> Array:
    """Speed over ground of the point of each foot that would touch it. Shape (4,), m/s.

    Args:
        state_feet: From :func:`feet`.
        velocity_m_s: The body's, in the body's frame. Shape (3,).
        turn_rate_rad_s: The body's, in the body's frame. Shape (3,).
        up: The upward direction in the body's frame. Shape (3,).
    """
    centres = velocity_m_s + np.cross(turn_rate_rad_s, state_feet.position_m) + state_feet.velocity_m_s
    soles = centres - facts.FOOT_RADIUS_M * np.cross(turn_rate_rad_s + state_feet.turn_rate_rad_s, up)
    speeds: Array = np.sqrt((soles * soles).sum(axis=1))
    return speeds
