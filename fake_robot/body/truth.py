"""The simulated body as it is: no delay, no noise. Field names are those of the admin service's answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fake_robot.body.body import Body
from spot_model.robot.facts import Array


@dataclass(frozen=True)
class Lateness:
    """How well robot time followed the host's clock, real time only."""

    wakes: int = 0
    late_wakes: int = 0
    """More than 1 ms after the time they were due."""
    max_late_s: float = 0.0
    lost_s: float = 0.0
    """Robot time given up after stalls."""


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
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Parameters of every effect in the hidden truth, by number and name."""
    power_w: float = 0.0
    lateness: Lateness = Lateness()


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
