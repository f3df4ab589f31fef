"""The parameters of the vendor's stand, stance and walk commands, read and brought into odom and over the feet."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from bosdyn.api import robot_command_pb2, trajectory_pb2
from bosdyn.api.spot import robot_command_pb2 as spot_command_pb2
from bosdyn.client.frame_helpers import ODOM_FRAME_NAME, get_a_tform_b
from bosdyn.client.math_helpers import Quat, SE2Pose, SE3Pose, quat_to_eulerZYX
from google.protobuf.message import DecodeError

from fake_robot.network.requests import PathPlan, PathPoint, StandPose, Velocity, VelocityPlan, WalkLimits, WalkPlan
from fake_robot.network.status import Array, Snapshot
from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.calls import ns_of
from fake_robot.services.reports.state_message import frame_tree
from spot_model.robot.facts import FOOT_RADIUS_M, LEG_NAMES

FOOTPRINT = "footprint"
"""The vendor's pseudo-frame over the feet; it is in no tree of frames."""
BODY_FRAMES = ("body", "flat_body")
WORLD_FRAMES = ("odom", "vision")
MAX_POINTS = 1000
MAX_DURATION_S = 600.0
DEFAULT_SLEW: Velocity = (4.0, 4.0, 2.0)
"""Where a velocity command names none: what the SDK's own builder sends."""
ACCURACY_M: Final = (0.02, 0.10)
"""Least and largest accuracy that can be asked for. Source: the proto."""


class RefusedCommandError(Exception):
    """The robot does not take the command, for the status of this name; the message says why."""

    def __init__(self, status: str, message: str) -> None:
        super().__init__(message)
        self.status = robot_command_pb2.RobotCommandResponse.Status.Value(f"STATUS_{status}")


@dataclass(frozen=True)
class CoursePoint:
    """The body's pose in the frame of its course, and when it shall be reached, after the course's reference time."""

    pose: SE3Pose
    since_reference_s: float


@dataclass(frozen=True)
class BodyCourse:
    """What a stand command asks of the body."""

    frame: str = FOOTPRINT
    reference_stamp_ns: int | None = None
    """Robot time; None for the time of receipt."""
    points: tuple[CoursePoint, ...] = ()


def read_course(packed: object) -> BodyCourse:
    """Read the mobility params of a stand command. Raises RefusedCommandError."""
    params = spot_command_pb2.MobilityParams()
    try:
        is_known = packed.Unpack(params)  # type: ignore[attr-defined]
    except DecodeError as error:
        raise _invalid(f"the mobility params cannot be read: {error}") from error
    if not is_known:
        raise _invalid(
            f"the mobility params are of type {packed.TypeName()!r}; allowed: {params.DESCRIPTOR.full_name}"  # type: ignore[attr-defined]
        )
    control = params.body_control
    if control.HasField("body_pose"):
        if not control.body_pose.root_frame_name:
            raise _invalid("body_pose has no root_frame_name")
        return _course(control.body_pose.root_frame_name, control.body_pose.base_offset_rt_root)
    return _course(FOOTPRINT, control.base_offset_rt_footprint)


def stand_poses(course: BodyCourse, snapshot: Snapshot) -> tuple[StandPose, ...]:
    """The course as offsets over the feet, as the robot believes to stand. Raises RefusedCommandError."""
    footprint_from_frame = SE3Pose.from_identity()
    if course.frame != FOOTPRINT:
        tree = frame_tree(snapshot)
        odom_from_frame = get_a_tform_b(tree, ODOM_FRAME_NAME, course.frame)
        if odom_from_frame is None:
            known = ", ".join(sorted(tree.child_to_parent_edge_map))
            raise RefusedCommandError("UNKNOWN_FRAME", f"there is no frame {course.frame!r}; frames: {known}")
        footprint_from_frame = _odom_from_footprint(snapshot).inverse() * odom_from_frame
    late_s = 0.0
    if course.reference_stamp_ns is not None:
        late_s = (snapshot.robot_stamp_ns - course.reference_stamp_ns) * 1e-9
    return tuple(_stand_pose(footprint_from_frame * p.pose, p.since_reference_s - late_s) for p in course.points)


def _course(frame: str, trajectory: trajectory_pb2.SE3Trajectory) -> BodyCourse:
    if len(trajectory.points) > MAX_POINTS:
        raise _invalid(f"the body trajectory has {len(trajectory.points)} points; allowed: {MAX_POINTS}")
    points: list[CoursePoint] = []
    for point in trajectory.points:
        at, turn = point.pose.position, point.pose.rotation
        rotation = Quat(turn.w, turn.x, turn.y, turn.z) if point.pose.HasField("rotation") else Quat()
        since_s = ns_of(point.time_since_reference) * 1e-9
        norm = math.hypot(rotation.w, rotation.x, rotation.y, rotation.z)
        if not all(map(math.isfinite, (at.x, at.y, at.z, norm))) or abs(norm - 1.0) > 0.1:
            raise _invalid("the body trajectory has a pose without finite position and unit quaternion")
        if not (points[-1].since_reference_s if points else 0.0) <= since_s <= MAX_DURATION_S:
            raise _invalid(f"the times of the body trajectory must rise, from 0 to {MAX_DURATION_S:g} s")
        rotation.normalize()
        points.append(CoursePoint(SE3Pose(at.x, at.y, at.z, rotation), since_s))
    reference_ns = ns_of(trajectory.reference_time) if trajectory.HasField("reference_time") else None
    return BodyCourse(frame, reference_ns, tuple(points))


def _odom_from_footprint(snapshot: Snapshot) -> SE3Pose:
    """Level; in the middle of the feet; ahead is from the hind to the front feet; as high as the body nominally is."""
    attitude = Quat(*snapshot.odom_from_body_wxyz.tolist())
    odom_from_body = SE3Pose(*snapshot.position_of_body_in_odom_m.tolist(), attitude)
    feet = [odom_from_body.transform_point(*foot) for foot in snapshot.foot_position_in_body_m.tolist()]
    x, y, z = (sum(axis) / len(feet) for axis in zip(*feet, strict=True))
    ahead = [feet[0][i] + feet[1][i] - feet[2][i] - feet[3][i] for i in (0, 1)]
    height_m = snapshot.stand_height_m - FOOT_RADIUS_M
    return SE3Pose(x, y, z + height_m, Quat.from_yaw(math.atan2(ahead[1], ahead[0])))


def _stand_pose(pose: SE3Pose, after_s: float) -> StandPose:
    yaw_rad, pitch_rad, roll_rad = quat_to_eulerZYX(pose.rot)  # to_yaw is not the angle that belongs to the other two
    return StandPose(
        pose.x, pose.y, pose.z, roll_rad, pitch_rad, yaw_rad, after_s=min(max(after_s, 0.0), MAX_DURATION_S)
    )


def read_velocity(request: Any, params: Any, config: ServicesConfig) -> Callable[[Snapshot], WalkPlan]:
    """Check an ``SE2VelocityCommand.Request``; returns what makes a plan of it once the robot's pose is known.

    Raises:
        RefusedCommandError: A number is none, the slew limit is negative, or the frame is another.
    """
    frame = _frame(request.se2_frame_name, (*BODY_FRAMES, *WORLD_FRAMES))
    velocity = _velocity("velocity", request.velocity)
    slew = (
        _velocity("slew_rate_limit", request.slew_rate_limit) if request.HasField("slew_rate_limit") else DEFAULT_SLEW
    )
    if min(slew) < 0.0:
        raise _invalid(f"slew_rate_limit = {slew}; allowed: at least 0")
    limits = _read_limits(request, params, config)
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


def read_trajectory(request: Any, params: Any, config: ServicesConfig) -> Callable[[Snapshot], WalkPlan]:
    """Check an ``SE2TrajectoryCommand.Request``; returns what makes a plan of it once the robot's pose is known.

    Raises:
        RefusedCommandError: It has no point, too many, or a value that is not finite, or the frame is another.
    """
    frame = _frame(request.se2_frame_name, ("body", *WORLD_FRAMES))
    trajectory = request.trajectory
    if not 1 <= len(trajectory.points) <= MAX_POINTS:
        raise _invalid(f"the trajectory has {len(trajectory.points)} points; allowed: 1 to {MAX_POINTS}")
    poses, times_s = [], [0.0]
    for point in trajectory.points:
        at = (point.pose.position.x, point.pose.position.y, point.pose.angle)
        after_s = ns_of(point.time_since_reference) * 1e-9
        if not all(map(math.isfinite, at)):
            raise _invalid("the trajectory holds a value that is no finite number")
        if not times_s[-1] <= after_s <= MAX_DURATION_S:
            raise _invalid(f"the times of the trajectory must rise, from 0 to {MAX_DURATION_S:g} s")
        poses.append(SE2Pose(*at))
        times_s.append(after_s)
    limits = _read_limits(request, params, config)

    def plan(snapshot: Snapshot) -> WalkPlan:
        odom_from_frame = _odom_from(frame, snapshot)
        late_s = 0.0
        if trajectory.HasField("reference_time"):
            late_s = (snapshot.robot_stamp_ns - ns_of(trajectory.reference_time)) * 1e-9
        points = []
        for pose, after_s in zip(poses, times_s[1:], strict=True):
            in_odom = odom_from_frame * pose
            points.append(PathPoint(in_odom.x, in_odom.y, in_odom.angle, max(after_s - late_s, 0.0)))
        return PathPlan(tuple(points), limits(snapshot))

    return plan


def read_stance(request: Any) -> tuple[Callable[[Snapshot], Array], float]:
    """Check a ``StanceCommand.Request``; returns what brings the feet's places into odom, and how exact they shall be.

    The places are of legs fl, fr, hl, hr; shape (4, 2), m.

    Raises:
        RefusedCommandError: A foot is missing, a number is none or out of its bounds, or the frame is another.
    """
    stance = request.stance
    frame = _frame(stance.se2_frame_name, (*WORLD_FRAMES, *BODY_FRAMES))
    if set(stance.foot_positions) != set(LEG_NAMES):
        given = ", ".join(sorted(stance.foot_positions)) or "none"
        raise _invalid(f"foot_positions has {given}; it needs each of {', '.join(LEG_NAMES)}")
    feet = [(stance.foot_positions[leg].x, stance.foot_positions[leg].y) for leg in LEG_NAMES]
    accuracy_m = stance.accuracy or 0.05
    if not all(math.isfinite(v) for foot in feet for v in foot):
        raise _invalid("foot_positions holds a value that is no finite number")
    if not ACCURACY_M[0] - 1e-6 <= accuracy_m <= ACCURACY_M[1] + 1e-6:
        raise _invalid(f"accuracy = {accuracy_m:g} m; allowed: {ACCURACY_M[0]:g} to {ACCURACY_M[1]:g} m")

    def in_odom_m(snapshot: Snapshot) -> Array:
        odom_from_frame = _odom_from(frame, snapshot)
        poses = [odom_from_frame * SE2Pose(x_m, y_m, 0.0) for x_m, y_m in feet]
        return np.array([(pose.x, pose.y) for pose in poses])

    return in_odom_m, accuracy_m


def _read_limits(request: Any, packed: Any, config: ServicesConfig) -> Callable[[Snapshot], WalkLimits]:
    end_ns = ns_of(request.end_time)
    high = (config.max_walking_speed_m_s, config.max_walking_speed_m_s, config.max_turn_rate_rad_s)
    low = (-high[0], -high[1], -high[2])
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


def _invalid(message: str) -> RefusedCommandError:
    return RefusedCommandError("INVALID_REQUEST", message)


def _frame(name: str, allowed: tuple[str, ...]) -> str:
    if name not in allowed:
        told = f"se2_frame_name = {name!r}; allowed for this command: {', '.join(allowed)}"
        raise RefusedCommandError("UNKNOWN_FRAME", told)
    return name


def _velocity(name: str, field: Any) -> Velocity:
    values = (field.linear.x, field.linear.y, field.angular)
    if not all(map(math.isfinite, values)):
        raise _invalid(f"{name} holds a value that is no finite number")
    return values


def _each(asked: Velocity, bound: Velocity, choose: Callable[[float, float], float]) -> Velocity:
    forward, left, turn = (choose(a, b) for a, b in zip(asked, bound, strict=True))
    return forward, left, turn


def _odom_from(frame: str, snapshot: Snapshot) -> SE2Pose:
    odom_from_frame = get_a_tform_b(frame_tree(snapshot), ODOM_FRAME_NAME, frame)
    return SE2Pose(odom_from_frame.x, odom_from_frame.y, odom_from_frame.rot.to_yaw())
