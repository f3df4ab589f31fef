"""What services ask of the robot: how to hold its body, where to walk, what to look at. No gRPC, no physics."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class StandPose:
    """Where a standing body shall be: offsets from the nominal stand over its feet (x forward, y left, z up)."""

    forward_m: float = 0.0
    left_m: float = 0.0
    height_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    after_s: float = 0.0
    """When it shall be there, from now on; it takes longer where that is too soon."""


Velocity: TypeAlias = tuple[float, float, float]
"""Forward and left in m/s, turn rate in rad/s."""


class WalkProgress(enum.Enum):
    """How far the newest walk has come."""

    NONE = "none"
    WALKING = "walking"
    ARRIVING = "arriving"
    """Near its goal, or coming to a stop there."""
    ARRIVED = "arrived"
    TIMED_OUT = "timed_out"
    """Its end time came first."""


@dataclass(frozen=True)
class WalkLimits:
    """Bounds that every walk obeys, and how the body is held meanwhile."""

    end_robot_stamp_ns: int
    low: Velocity
    high: Velocity
    pose: StandPose = StandPose()
    """Offsets of the body from its nominal pose; height, roll and pitch count."""


@dataclass(frozen=True)
class VelocityPlan:
    """Walk with a velocity until the end."""

    velocity: Velocity
    is_in_body: bool
    """Along the body's axes; along those of odom otherwise."""
    slew: Velocity
    """Largest change of the velocity, m/s² and rad/s²."""
    limits: WalkLimits


@dataclass(frozen=True)
class PathPoint:
    """A pose of the body on the ground, in odom, and when it shall be reached, from the start of the walk."""

    x_m: float
    y_m: float
    yaw_rad: float
    after_s: float = 0.0


@dataclass(frozen=True)
class PathPlan:
    """Walk along points, to the last one."""

    points: tuple[PathPoint, ...]
    limits: WalkLimits


WalkPlan: TypeAlias = VelocityPlan | PathPlan


MAX_DEPTH_M = 4.0
"""Depth cameras see no further. Source: the vendor's data sheet."""


@dataclass(frozen=True)
class CameraView:
    """One camera with a pinhole lens that sees 90 degrees across."""

    position_in_body_m: tuple[float, float, float]
    body_from_lens_wxyz: tuple[float, float, float, float]
    """The lens' z looks ahead, its x to the right and its y down."""
    cols: int
    rows: int
    is_depth: bool

    @property
    def field_of_view_y_rad(self) -> float:
        """Angle between the image's upper and lower edge."""
        return 2.0 * math.atan(self.rows / self.cols)
