"""Putting the feet to given places, one after the other, while the body leans over the three that stand."""

from __future__ import annotations

import math

import numpy as np

from fake_robot.robot.motion.vendor_motion import ROWS_PER_S, Path, leg_angles_rad, smooth, weight_load_nm
from spot_model.robot.facts import N_LEGS, Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m

REACH_M = 0.25
"""How far a foot may be moved by a stance; further away is too far. The vendor publishes no bound."""
MAX_ROUNDS = 5
"""How often each foot may step until all stand as exactly as asked."""
AIM_SHARE = 0.6
"""How much of what a round has missed the next one aims beyond; at 1, rounds overshoot by turns."""
_LEAN_SHARE = 0.4
"""How far the body leans from over four feet to over the three that stand."""
_LEAN_S, _SWING_S, _LIFT_M = 0.6, 0.5, 0.06
_MASS_M = np.array([-0.026, 0.0, 0.0])
"""Where the robot's mass lies in a stand, from the body's origin: what the feet's loads there say."""
_ORDER = (2, 0, 3, 1)
"""hl, fl, hr, fr: a hind foot before the front one of its side."""


def stance_path(start_rad: Array, goal_in_body_m: Array, *, mass_kg: float) -> Path:
    """Set-points that move the feet of a stand, given by its joint positions, to other places on the ground.

    Joint positions have shape (12,). The goal is x and y of the feet in the body's axes at the start, shape (4, 2).
    """
    feet = foot_position_in_body_m(start_rad).copy()
    # All feet end at one height, or the body would lean a little more with every round of steps.
    goal = np.column_stack([goal_in_body_m, np.full(N_LEGS, feet[:, 2].mean())])
    body = np.zeros(3)
    rows, shares = [feet.copy()], [load_shares(feet)]
    for leg in _ORDER:
        others = [other for other in range(N_LEGS) if other != leg]
        middle = feet.mean(axis=0)
        lean = (middle + _LEAN_SHARE * (feet[others].mean(axis=0) - middle) - _MASS_M) * (1.0, 1.0, 0.0)
        for weight in _weights(_LEAN_S):
            rows.append(feet - (body + weight * (lean - body)))
            shares.append(load_shares(rows[-1]))
        body, start = lean, feet[leg].copy()
        for weight in _weights(_SWING_S):
            feet[leg] = start + weight * (goal[leg] - start)
            feet[leg, 2] += _LIFT_M * np.sin(np.pi * weight)
            rows.append(feet - body)
            shares.append(load_shares(rows[-1], without=leg))
        feet[leg] = goal[leg]
    centre = feet.mean(axis=0) * (1.0, 1.0, 0.0)
    ahead = feet[:2].mean(axis=0) - feet[2:].mean(axis=0)
    turn_rad = math.atan2(ahead[1], ahead[0])
    for weight in _weights(_LEAN_S):
        cos, sin = math.cos(weight * turn_rad), math.sin(weight * turn_rad)
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        rows.append((feet - (body + weight * (centre - body))) @ turned)
        shares.append(load_shares(rows[-1]))
    angles = leg_angles_rad(np.array(rows))
    # The first rows lead from the true joints to the path, which may differ at the limits.
    fade = np.linspace(1.0, 0.0, len(angles))[:, np.newaxis] ** 8
    angles = angles + fade * (start_rad - angles[0])
    load = weight_load_nm(angles, mass_kg, np.array(shares))
    return Path(angles, load, (len(angles) - 1) / ROWS_PER_S)


def load_shares(feet_in_body_m: Array, without: int | None = None) -> Array:
    """Each foot's share of the weight of a body at rest above its feet: the smallest forces that balance it.

    The feet have shape (4, 3), x forward, y left; the foot ``without`` does not stand. Shares, shape (4,), sum to 1.
    """
    standing = [leg for leg in range(N_LEGS) if leg != without]
    balance = np.vstack([np.ones(len(standing)), feet_in_body_m[standing, :2].T])
    share = np.zeros(N_LEGS)
    share[standing] = np.linalg.pinv(balance) @ (1.0, *_MASS_M[:2])
    return share


def _weights(duration_s: float) -> list[float]:
    """A smooth course from 0 to 1, without the 0."""
    course = smooth(np.linspace(0.0, 1.0, round(duration_s * ROWS_PER_S) + 1))
    return [float(weight) for weight in course[1:]]
