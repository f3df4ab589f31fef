"""The vendor's walking commands as plans in odom: velocity, trajectory, and their limits. No gRPC."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bosdyn.api.spot import robot_command_pb2 as spot_command_pb2
from bosdyn.client.frame_helpers import ODOM_FRAME_NAME, get_a_tform_b
from bosdyn.client.math_helpers import SE2Pose

from fake_robot.network.stand_pose import StandPose
from fake_robot.network.status import Snapshot
from fake_robot.network.walk_plan import PathPlan, PathPoint, Velocity, VelocityPlan, WalkLimits, WalkPlan
from fake_robot.services.calls.stamps import ns_from_duration, ns_from_timestamp
from fake_robot.services.motion.refusals import InvalidCommandError, UnknownFrameError
from fake_robot.services.motion.stand_params import (
    FOOTPRINT,
    MAX_DURATION_S,
    MAX_POINTS,
    BodyCourse,
    read_course,
    stand_poses,
)
from fake_robot.services.reports.robot_state_message import frame_tree

BODY_FRAMES = ("body", "flat_body")
WORLD_FRAMES = ("odom", "vision")
DEFAULT_SLEW: Velocity = (4.0, 4.0, 2.0)
"""Where a velocity command names none: what the SDK's own builder sends."""


@dataclass(frozen=True)
class WalkBounds:
    """How fast the vendor's commands may walk."""

    speed_m_s: float
    turn_rate_rad_s: float


def read_velocity(request: Any, params: Any, bounds: WalkBounds) -> Callable[[Snapshot], WalkPlan]:
    """Check an ``SE2VelocityCommand.Request``; returns what makes a plan of it once the robot's pose is known.

    Raises:
        InvalidCommandError: A number is none, or the slew limit is negative.
        UnknownFrameError: It is in another frame than the robot takes.
    """
    frame = _frame(request.se2_frame_name, (*BODY_FRAMES, *WORLD_FRAMES))
    velocity = _velocity("velocity", request.velocity)
    slew = (
        _velocity("slew_rate_limit", request.slew_rate_limit) if request.HasField("slew_rate_limit") else DEFAULT_SLEW
    )
    if min(slew) < 0.0:
        raise InvalidCommandError(f"slew_rate_limit = {slew}; allowed: at least 0")
    limits = _read_limits(request, params, bounds)
    forward, left, turn = (given or default for given, default in zip(slew, DEFAULT_SLEW, strict=True))

    def plan(snapshot: Snapshot) -> WalkPlan:
        is_in_body = frame in BODY_FRAMES
        turned = velocity
        if not is_in_body:
            yaw_rad = _odom_from(frame, snapshot).angle
            cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
            turned = (cos * velocity[0] - sin * velocity[1], sin * velocity[0] + cos * velocity[1], velocity[2])
        return VelocityPlan(turned, is_in_body, (forward, left, turn), limits(snapshot))

    return plan


def read_trajectory(request: Any, params: Any, bounds: WalkBounds) -> Callable[[Snapshot], WalkPlan]:
    """Check an ``SE2TrajectoryCommand.Request``; returns what makes a plan of it once the robot's pose is known.

    Raises:
        InvalidCommandError: It has no point, too many, or a value that is not finite.
        UnknownFrameError: It is in another frame than the robot takes.
    """
    frame = _frame(request.se2_frame_name, ("body", *WORLD_FRAMES))
    trajectory = request.trajectory
    if not 1 <= len(trajectory.points) <= MAX_POINTS:
        raise InvalidCommandError(f"the trajectory has {len(trajectory.points)} points; allowed: 1 to {MAX_POINTS}")
    poses, times_s = [], [0.0]
    for point in trajectory.points:
        at = (point.pose.position.x, point.pose.position.y, point.pose.angle)
        after_s = ns_from_duration(point.time_since_reference) * 1e-9
        if not all(map(math.isfinite, at)):
            raise InvalidCommandError("the trajectory holds a value that is no finite number")
        if not times_s[-1] <= after_s <= MAX_DURATION_S:
            raise InvalidCommandError(f"the times of the trajectory must rise, from 0 to {MAX_DURATION_S:g} s")
        poses.append(SE2Pose(*at))
        times_s.append(after_s)
    limits = _read_limits(request, params, bounds)

    def plan(snapshot: Snapshot) -> WalkPlan:
        odom_from_frame = _odom_from(frame, snapshot)
        late_s = 0.0
        if trajectory.HasField("reference_time"):
            late_s = (snapshot.robot_stamp_ns - ns_from_timestamp(trajectory.reference_time)) * 1e-9
        points = []
        for pose, after_s in zip(poses, times_s[1:], strict=True):
            in_odom = odom_from_frame * pose
            points.append(PathPoint(in_odom.x, in_odom.y, in_odom.angle, max(after_s - late_s, 0.0)))
        return PathPlan(tuple(points), limits(snapshot))

    return plan


def odom_point(frame: str, x_m: float, y_m: float, snapshot: Snapshot) -> tuple[float, float]:
    """A point on the ground of a frame, in odom."""
    at = _odom_from(frame, snapshot) * SE2Pose(x_m, y_m, 0.0)
    return at.x, at.y


def _read_limits(request: Any, packed: Any, bounds: WalkBounds) -> Callable[[Snapshot], WalkLimits]:
    end_ns = ns_from_timestamp(request.end_time)
    high = (bounds.speed_m_s, bounds.speed_m_s, bounds.turn_rate_rad_s)
    low = (-bounds.speed_m_s, -bounds.speed_m_s, -bounds.turn_rate_rad_s)
    course: BodyCourse | None = None
    if packed is not None:
        course = read_course(packed)
        params = spot_command_pb2.MobilityParams()
        packed.Unpack(params)
        # A component of zero says nothing: proto3 cannot tell it from one that was left out.
        if params.vel_limit.HasField("max_vel"):
            asked = _velocity("vel_limit.max_vel", params.vel_limit.max_vel)
            high = _each(asked, high, lambda a, b: min(a, b) if a > 0.0 else b)
        if params.vel_limit.HasField("min_vel"):
            asked = _velocity("vel_limit.min_vel", params.vel_limit.min_vel)
            low = _each(asked, low, lambda a, b: max(a, b) if a < 0.0 else b)

    def limits(snapshot: Snapshot) -> WalkLimits:
        poses = stand_poses(course, snapshot) if course is not None and course.frame == FOOTPRINT else ()
        return WalkLimits(end_ns, low, high, poses[-1] if poses else StandPose())

    return limits


def _frame(name: str, allowed: tuple[str, ...]) -> str:
    if name not in allowed:
        raise UnknownFrameError(f"se2_frame_name = {name!r}; allowed for this command: {', '.join(allowed)}")
    return name


def _velocity(name: str, field: Any) -> Velocity:
    values = (field.linear.x, field.linear.y, field.angular)
    if not all(map(math.isfinite, values)):
        raise InvalidCommandError(f"{name} holds a value that is no finite number")
    return values


def _each(asked: Velocity, bound: Velocity, choose: Callable[[float, float], float]) -> Velocity:
    forward, left, turn = (choose(a, b) for a, b in zip(asked, bound, strict=True))
    return forward, left, turn


def _odom_from(frame: str, snapshot: Snapshot) -> SE2Pose:
    odom_from_frame = get_a_tform_b(frame_tree(snapshot), ODOM_FRAME_NAME, frame)
    return SE2Pose(odom_from_frame.x, odom_from_frame.y, odom_from_frame.rot.to_yaw())
