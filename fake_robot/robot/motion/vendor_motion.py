"""The vendor's own stand and sit, as seen from outside: set-points along a path of the feet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fake_robot.body.body import SIT_POSITION_RAD
from fake_robot.network.requests import StandPose
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_and_jacobian, foot_position_in_body_m

ROWS_PER_S = 100
"""Set-points a second in a path."""
_TUCK_SHARE = 0.35
"""Part of a stand or sit in which the feet are put in place under a body that lies on the ground."""
NOMINAL_STAND = StandPose()
_LEAST_S = 0.3
"""Between two poses of a course."""
_REACH = np.array([0.12, 0.12, 0.25, 0.5, 0.5, 0.5])
"""How far a stand's body shifts (m) and turns (rad): about as far as the legs reach. The vendor publishes no bounds."""
_GRAVITY_M_S2 = 9.81
_THIGH_M = math.hypot(*facts.KN_FROM_HY_M)
_SHANK_M = math.hypot(*facts.FOOT_FROM_KN_M)


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

    From shape (n, 4, 3), legs fl, fr, hl, hr, to shape (n, 12), canonical order, clipped to the joints' limits. A foot
    out of reach is put as near as it gets.
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


def stand_feet_m(body_height_m: float, pose: StandPose = NOMINAL_STAND) -> Array:
    """Foot centres of a stand in the body frame, shape (4, 3)."""
    feet: Array = _feet_of_course(body_height_m, _row(pose)[np.newaxis])[0]
    return feet


def stand_path(
    start_rad: Array,
    *,
    is_low: bool,
    duration_s: float,
    body_height_m: float,
    mass_kg: float,
    course: Sequence[StandPose],
) -> Path:
    """From where the joints are to a stand, and on along a course of its poses, at rest in each.

    A body that lies or sits (``is_low``) has its feet put in place first, and is lifted straight up. The first of at
    least one pose is reached after ``duration_s``, if it does not ask for more. An offset beyond the legs' reach is cut
    to it.
    """
    if is_low and course[0].after_s > duration_s:
        course = (StandPose(after_s=duration_s), *course)
    time_s = max(duration_s, course[0].after_s)
    n = max(4, round(time_s * ROWS_PER_S))
    rows, bearing = _rise(start_rad, stand_feet_m(body_height_m, course[0]), n, is_low=is_low)
    for before, after in pairwise(course):
        steps = max(4, round(max(_LEAST_S, after.after_s - time_s) * ROWS_PER_S))
        time_s += steps / ROWS_PER_S
        weight = smooth(np.linspace(0.0, 1.0, steps + 1))[1:, np.newaxis]
        poses = _row(before) + weight * (_row(after) - _row(before))
        rows = np.concatenate([rows, leg_angles_rad(_feet_of_course(body_height_m, poses))])
    bearing = np.concatenate([bearing, np.ones(len(rows) - len(bearing))])
    return Path(rows, weight_load_nm(rows, mass_kg) * bearing[:, np.newaxis], time_s)


def _rise(start_rad: Array, target_m: Array, n: int, *, is_low: bool) -> tuple[Array, Array]:
    """Joint positions from the start to feet at ``target_m``, shape (n + 1, 12); and the share of the load borne."""
    if not is_low:
        return _blend(start_rad, leg_angles_rad(target_m), np.linspace(0.0, 1.0, n + 1)), np.ones(n + 1)
    tuck = max(2, round(_TUCK_SHARE * n))
    first = _blend(start_rad, SIT_POSITION_RAD, np.linspace(0.0, 1.0, tuck + 1))
    low = foot_position_in_body_m(SIT_POSITION_RAD)
    part = np.linspace(0.0, 1.0, n - tuck + 1)[1:]
    rows = np.concatenate([first, leg_angles_rad(low + smooth(part)[:, np.newaxis, np.newaxis] * (target_m - low))])
    return rows, np.concatenate([np.zeros(tuck + 1), np.minimum(1.0, 8.0 * part)])


def _row(pose: StandPose) -> Array:
    """A pose as forward, left, height, roll, pitch, yaw, cut to what the legs reach."""
    row = (pose.forward_m, pose.left_m, pose.height_m, pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
    return np.asarray(np.clip(np.array(row), -_REACH, _REACH))


def _feet_of_course(body_height_m: float, poses: Array) -> Array:
    """Foot centres in the body frame for poses of shape (n, 6), as rows of ``_row``; shape (n, 4, 3)."""
    feet = np.array(
        [
            (
                facts.end_sign(leg) * facts.HX_FROM_BODY_M[0],
                facts.side_sign(leg) * (facts.HX_FROM_BODY_M[1] + facts.HY_FROM_HX_M[1]),
                facts.FOOT_RADIUS_M - body_height_m,
            )
            for leg in facts.LEG_NAMES
        ]
    )
    level = feet - poses[:, np.newaxis, :3]
    return np.asarray(level @ _level_from_body(poses[:, 3], poses[:, 4], poses[:, 5]))


def sit_path(start_rad: Array, *, duration_s: float, mass_kg: float) -> Path:
    """From a stand straight down until the body lies on the ground, legs folded."""
    n = max(4, round(duration_s * ROWS_PER_S))
    weight = np.linspace(0.0, 1.0, n + 1)
    feet = foot_position_in_body_m(start_rad)
    low = foot_position_in_body_m(SIT_POSITION_RAD)
    s = smooth(weight)[:, np.newaxis, np.newaxis]
    rows = leg_angles_rad(feet + s * (low - feet))
    # The first rows lead from the true joints to the path, which may differ at the limits.
    rows = rows + (1.0 - smooth(weight))[:, np.newaxis] * (start_rad - rows[0])
    bearing = np.clip(8.0 * (1.0 - weight), 0.0, 1.0)[:, np.newaxis]
    return Path(rows, weight_load_nm(rows, mass_kg) * bearing, duration_s)


def hold_path(position_rad: Array) -> Path:
    """Stay where the joints are."""
    rows = np.repeat(position_rad[np.newaxis], 2, axis=0)
    return Path(rows, np.zeros_like(rows), 1.0)


def _blend(start: Array, goal: Array, weight: Array) -> Array:
    return np.asarray(start + smooth(weight)[:, np.newaxis] * (goal - start))


def smooth(weight: Array) -> Array:
    """Minimum-jerk course from 0 to 1, any shape."""
    return np.asarray(weight**3 * (10.0 - 15.0 * weight + 6.0 * weight**2))


def weight_load_nm(position_rad: Array, mass_kg: float, share: Array | float = 1.0 / facts.N_LEGS) -> Array:
    """Joint torques that bear the weight of a level body at joint positions; both of shape (n, 12).

    ``share`` is each foot's of the weight, shape (n, 4), or one for all.
    """
    _, jacobian = foot_position_and_jacobian(position_rad)
    weight = mass_kg * _GRAVITY_M_S2 * np.broadcast_to(share, (len(position_rad), facts.N_LEGS))
    # The ground pushes the foot up with f; the joints balance it with −Jᵀf.
    load: Array = -jacobian[..., 2, :] * weight[..., np.newaxis]
    rows: Array = load.reshape(position_rad.shape)
    return rows


def _level_from_body(roll_rad: Array, pitch_rad: Array, yaw_rad: Array) -> Array:
    """Rotation matrices that express vectors of the body in the level frame, shape (n, 3, 3)."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll_rad, pitch_rad, yaw_rad) for f in (np.cos, np.sin))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
