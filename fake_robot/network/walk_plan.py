"""Where a walking robot is asked to go: with a velocity, or along points on the ground. No gRPC, no physics."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TypeAlias

from fake_robot.network.stand_pose import StandPose

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
