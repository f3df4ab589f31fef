"""The simulated body as it is: no delay, no noise. Field names are those of the admin service's answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fake_robot.body.body import Body
from spot_model.robot.facts import Array


@dataclass(frozen=True)
class Truth:
    """One instant. Canonical joint order, legs fl fr hl hr, SI units."""

    robot_stamp_ns: int
    position_of_body_in_world_m: Array
    world_from_body_wxyz: Array
    linear_vel_of_body_in_world_m_s: Array
    angular_vel_of_body_in_body_rad_s: Array
    body_height_m: float
    joint_position_rad: Array
    joint_velocity_rad_s: Array
    joint_torque_nm: Array
    """What the motors apply, after every limit."""
    foot_contact: NDArray[np.bool_]
    foot_force_n: Array
    has_fallen: bool
    body_height_min_m: float
    peak_torque_nm: float


class Extremes:
    """Lowest body and greatest torque since the start, or since the last reset."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Start afresh."""
        self.height_min_m, self.peak_torque_nm = float("inf"), 0.0

    def note(self, body: Body) -> None:
        """Look at the body now."""
        self.height_min_m = min(self.height_min_m, body.height_m())
        self.peak_torque_nm = max(self.peak_torque_nm, float(np.abs(body.motor_torque_nm).max()))
