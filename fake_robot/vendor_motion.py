"""The vendor's own stand and sit, as seen from outside: set-points along a path of the feet."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from spot_model import facts
from spot_model.facts import Array
from spot_model.leg_kinematics import foot_position_and_jacobian, foot_position_in_body_m

_ROWS_PER_S = 100
_TUCK_SHARE = 0.35
"""Part of a stand or sit in which the feet are put in place under a body that lies on the ground."""
_GRAVITY_M_S2 = 9.81
SIT_POSITION_RAD = np.array([v for leg in facts.LEG_NAMES for v in (0.3 * facts.side_sign(leg), 2.2, -2.76)])
"""Legs folded, feet beside and behind the hips, shape (12,); the body lies, or nearly so."""
_THIGH_M = math.hypot(*facts.KN_FROM_HY_M)
_SHANK_M = math.hypot(*facts.FOOT_FROM_KN_M)


@dataclass(frozen=True)
class Attitude:
    """Offsets of a stand: height over the nominal one (m), and angles of the body (rad)."""

    height_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Path:
    """Set-points over time."""

    position_rad: Array
    """Shape (n, 12)."""
    load_nm: Array
    """Feed-forward against the body's weight, shape (n, 12)."""
    duration_s: float

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Position and load at a time since the start, each of shape (12,); the last ones after the end."""
        n = len(self.position_rad) - 1
        x = min(max(time_s / self.duration_s, 0.0), 1.0) * n
        i = min(int(x), n - 1)
        w = x - i
        return (
            self.position_rad[i] + w * (self.position_rad[i + 1] - self.position_rad[i]),
            self.load_nm[i] + w * (self.load_nm[i + 1] - self.load_nm[i]),
        )


def leg_angles_rad(foot_in_body_m: Array) -> Array:
    """Joint angles that put the foot centres there, knees bent backwards.

    Args:
        foot_in_body_m: Shape (n, 4, 3), legs fl, fr, hl, hr.

    Returns:
        Shape (n, 12), canonical order, clipped to the joints' limits. A foot out of reach is put as near as it gets.
    """
    side = np.array([facts.side_sign(leg) for leg in facts.LEG_NAMES])
    end = np.array([facts.end_sign(leg) for leg in facts.LEG_NAMES])
    x = foot_in_body_m[..., 0] - end * facts.HX_FROM_BODY_M[0] - facts.HY_FROM_HX_M[0]
    y = foot_in_body_m[..., 1] - side * facts.HX_FROM_BODY_M[1]
    z = foot_in_body_m[..., 2]
    out = side * facts.HY_FROM_HX_M[1]
    # Across: the leg's plane turns about x until it holds the foot.
    down = np.sqrt(np.maximum(y**2 + z**2 - out**2, 1e-6))
    hx = np.arctan2(y, -z) - np.arctan2(out, down)
    # Along: two links in the plane. The thigh leans from its line by a fixed angle.
    reach = np.clip(np.hypot(x, down), abs(_THIGH_M - _SHANK_M) + 1e-6, _THIGH_M + _SHANK_M - 1e-6)
    bend = np.arccos((_THIGH_M**2 + _SHANK_M**2 - reach**2) / (2 * _THIGH_M * _SHANK_M))
    lean = math.atan2(facts.KN_FROM_HY_M[0], -facts.KN_FROM_HY_M[2])
    at_hip = np.arccos((_THIGH_M**2 + reach**2 - _SHANK_M**2) / (2 * _THIGH_M * reach))
    thigh = np.arctan2(-x, down) + at_hip
    hy = thigh + lean
    kn = bend - math.pi - lean
    angles = np.stack([hx, hy, kn], axis=-1).reshape(*foot_in_body_m.shape[:-2], facts.N_JOINTS)
    return np.asarray(np.clip(angles, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD))


def stand_feet_m(body_height_m: float, attitude: Attitude = Attitude()) -> Array:
    """Foot centres of a stand in the body frame, shape (4, 3)."""
    feet = np.array(
        [
            (
                facts.end_sign(leg) * facts.HX_FROM_BODY_M[0],
                facts.side_sign(leg) * (facts.HX_FROM_BODY_M[1] + facts.HY_FROM_HX_M[1]),
                facts.FOOT_RADIUS_M - body_height_m - attitude.height_m,
            )
            for leg in facts.LEG_NAMES
        ]
    )
    return np.asarray(feet @ _body_from_level(attitude).T)


def stand_path(
    start_rad: Array, *, is_low: bool, duration_s: float, body_height_m: float, mass_kg: float, attitude: Attitude
) -> Path:
    """From where the joints are to a stand.

    Args:
        start_rad: Joint positions now, shape (12,).
        is_low: Whether the body lies or sits: then the feet are put in place first, and lift it straight up.
        duration_s: Time for all of it.
        body_height_m: Height of the body's origin over the ground.
        mass_kg: Mass that the legs bear.
        attitude: Offsets.
    """
    n = max(4, round(duration_s * _ROWS_PER_S))
    target = stand_feet_m(body_height_m, attitude)
    weight = np.linspace(0.0, 1.0, n + 1)
    if not is_low:
        goal = leg_angles_rad(target[np.newaxis])[0]
        rows = _blend(start_rad, goal, weight)
        return Path(rows, _weight_load_nm(rows, mass_kg), duration_s)
    tuck = max(2, round(_TUCK_SHARE * n))
    first = _blend(start_rad, SIT_POSITION_RAD, np.linspace(0.0, 1.0, tuck + 1))
    low = foot_position_in_body_m(SIT_POSITION_RAD)
    s = _smooth(np.linspace(0.0, 1.0, n - tuck + 1))[1:, np.newaxis, np.newaxis]
    rows = np.concatenate([first, leg_angles_rad(low + s * (target - low))])
    bearing = np.concatenate([np.zeros(tuck + 1), np.minimum(1.0, 8.0 * np.linspace(0.0, 1.0, n - tuck + 1)[1:])])
    return Path(rows, _weight_load_nm(rows, mass_kg) * bearing[:, np.newaxis], duration_s)


def sit_path(start_rad: Array, *, duration_s: float, mass_kg: float) -> Path:
    """From a stand straight down until the body lies on the ground, legs folded."""
    n = max(4, round(duration_s * _ROWS_PER_S))
    weight = np.linspace(0.0, 1.0, n + 1)
    feet = foot_position_in_body_m(start_rad)
    low = foot_position_in_body_m(SIT_POSITION_RAD)
    s = _smooth(weight)[:, np.newaxis, np.newaxis]
    rows = leg_angles_rad(feet + s * (low - feet))
    # The first rows lead from the true joints to the path, which may differ at the limits.
    rows = rows + (1.0 - _smooth(weight))[:, np.newaxis] * (start_rad - rows[0])
    bearing = np.clip(8.0 * (1.0 - weight), 0.0, 1.0)[:, np.newaxis]
    return Path(rows, _weight_load_nm(rows, mass_kg) * bearing, duration_s)


def hold_path(position_rad: Array) -> Path:
    """Stay where the joints are."""
    rows = np.repeat(position_rad[np.newaxis], 2, axis=0)
    return Path(rows, np.zeros_like(rows), 1.0)


def _blend(start: Array, goal: Array, weight: Array) -> Array:
    return np.asarray(start + _smooth(weight)[:, np.newaxis] * (goal - start))


def _smooth(weight: Array) -> Array:
    """Minimum-jerk course from 0 to 1."""
    return np.asarray(weight**3 * (10.0 - 15.0 * weight + 6.0 * weight**2))


def _weight_load_nm(position_rad: Array, mass_kg: float) -> Array:
    """Joint torques that bear a quarter of the weight on each foot of a level body, shape (n, 12)."""
    _, jacobian = foot_position_and_jacobian(position_rad)
    # The ground pushes the foot up with f; the joints balance it with −Jᵀf.
    load: Array = -jacobian[..., 2, :] * (mass_kg * _GRAVITY_M_S2 / facts.N_LEGS)
    rows: Array = load.reshape(position_rad.shape)
    return rows


def _body_from_level(attitude: Attitude) -> Array:
    """Rotation matrix that expresses a vector of the level frame in the body's, shape (3, 3)."""
    cr, sr = math.cos(attitude.roll_rad), math.sin(attitude.roll_rad)
    cp, sp = math.cos(attitude.pitch_rad), math.sin(attitude.pitch_rad)
    cy, sy = math.cos(attitude.yaw_rad), math.sin(attitude.yaw_rad)
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray((about_z @ about_y @ about_x).T)
