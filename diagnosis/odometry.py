"""What a robot's state estimator makes of its velocity: legs that stand tell how fast the body moves, and they err.

A real robot does not know its velocity. Its estimator integrates the accelerometer, and feet that are taken to stand
still pull the integral back: every give of the ground, every roll and slip of a foot ends up in the velocity that the
policy sees. A simulation that shows the policy the true velocity is another closed loop.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.dynamics import contact_point_and_jacobian
from diagnosis.channels.vectors import cross
from spot_model import facts
from spot_model.plant import Plant
from spot_model.rotation import rotate_wxyz

Array = NDArray[np.float64]

STANDS_AFTER_S: Final = 0.025
"""A foot that has just touched down still moves, and estimators leave it out."""


class LegOdometry:
    """The error of a complementary filter: the accelerometer in the short run, standing feet in the long run.

    With v the true velocity and u the mean velocity of the standing feet's lowest points, by joints, gyroscope and
    attitude as the robot has them, the estimate v + e follows de/dt = −(u + e)/T: where feet truly stand, e vanishes.

    Args:
        time_s: T of each run, shape (n,); 0 for no error.
    """

    def __init__(self, time_s: Array) -> None:
        n = len(time_s)
        dt_s = facts.STATE_PERIOD_NS * 1e-9
        self._rows = np.flatnonzero(time_s > 0.0)
        self._pull = -np.expm1(-dt_s / time_s[self._rows])[:, None]
        self._after = round(STANDS_AFTER_S / dt_s)
        self._states_on = np.zeros((len(self._rows), facts.N_LEGS), dtype=np.int64)
        self._error: Array = np.zeros((n, 3))

    def error_m_s(self, plant: Plant) -> Array:
        """Take in another state; returns what the reported velocity is off by, world frame, shape (n, 3)."""
        rows = self._rows
        self._states_on = np.where(plant.foot_contact[rows], self._states_on + 1, 0)
        stands = self._states_on > self._after
        count = stands.sum(axis=1, keepdims=True)
        velocity = _foot_velocity_m_s(plant, rows)
        mean = np.where(stands[..., None], velocity, 0.0).sum(axis=1) / np.maximum(count, 1)
        self._error[rows] -= np.where(count > 0, self._pull * (mean + self._error[rows]), 0.0)
        return self._error.copy()


def _foot_velocity_m_s(plant: Plant, rows: NDArray[np.intp]) -> Array:
    """Of the feet's lowest points, world frame, by what the robot knows of its joints; shape (n, 4, 3)."""
    attitude = plant.world_from_body_wxyz[rows]
    position = np.asarray(plant.reading.position_rad)[rows]
    n = len(position)
    point, jacobian = contact_point_and_jacobian(position, attitude, np.full(facts.N_LEGS, facts.FOOT_RADIUS_M))
    rates = np.asarray(plant.reading.velocity_rad_s)[rows].reshape(n, facts.N_LEGS, 1, 3)
    turn = plant.angular_vel_of_body_in_body_rad_s[rows, None, :]
    own = plant.linear_vel_of_body_in_body_m_s[rows, None, :]
    velocity = own + cross(turn, point) + (jacobian * rates).sum(axis=-1)
    return np.asarray(rotate_wxyz(attitude[:, None, :], velocity))
