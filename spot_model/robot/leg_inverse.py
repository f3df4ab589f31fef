"""Inverse leg kinematics: joint angles that put the feet at given places."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_and_jacobian

STEPS: Final = 30
LONGEST_STEP_RAD: Final = 0.2
TOLERANCE_M: Final = 1e-6


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
    for _ in range(STEPS):
        at, jacobian = foot_position_and_jacobian(q)
        left = wanted - np.asarray(at)
        if np.max(np.abs(left), initial=0.0) < TOLERANCE_M:
            return q
        step = np.linalg.solve(np.asarray(jacobian), left[..., None])[..., 0]
        q = q + np.clip(step, -LONGEST_STEP_RAD, LONGEST_STEP_RAD).reshape(q.shape)
    far_m = float(np.max(np.abs(wanted - np.asarray(foot_position_and_jacobian(q)[0]))))
    raise ValueError(f"a foot stays {far_m:.3f} m from where it should be; ask for less")
