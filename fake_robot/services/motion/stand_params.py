"""The course of the body in a stand command, in whatever frame it comes, as offsets over the feet. No gRPC."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bosdyn.api import trajectory_pb2
from bosdyn.api.spot import robot_command_pb2 as spot_command_pb2
from bosdyn.client.frame_helpers import ODOM_FRAME_NAME, get_a_tform_b
from bosdyn.client.math_helpers import Quat, SE3Pose
from google.protobuf.message import DecodeError

from fake_robot.network.stand_pose import StandPose
from fake_robot.network.status import Snapshot
from fake_robot.services.calls.stamps import ns_from_duration, ns_from_timestamp
from fake_robot.services.motion.refusals import InvalidCommandError, UnknownFrameError
from fake_robot.services.reports.robot_state_message import frame_tree
from spot_model.robot.facts import FOOT_RADIUS_M

FOOTPRINT = "footprint"
"""The vendor's pseudo-frame over the feet; it is in no tree of frames."""
MAX_POINTS = 1000
MAX_DURATION_S = 600.0


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
    """Read the mobility params of a stand command.

    Raises:
        InvalidCommandError: They cannot be read, or hold a value that is not finite.
    """
    params = spot_command_pb2.MobilityParams()
    try:
        is_known = packed.Unpack(params)  # type: ignore[attr-defined]
    except DecodeError as error:
        raise InvalidCommandError(f"the mobility params cannot be read: {error}") from error
    if not is_known:
        raise InvalidCommandError(
            f"the mobility params are of type {packed.TypeName()!r}; allowed: {params.DESCRIPTOR.full_name}"  # type: ignore[attr-defined]
        )
    control = params.body_control
    if control.HasField("body_pose"):
        if not control.body_pose.root_frame_name:
            raise InvalidCommandError("body_pose has no root_frame_name")
        return _course(control.body_pose.root_frame_name, control.body_pose.base_offset_rt_root)
    return _course(FOOTPRINT, control.base_offset_rt_footprint)


def stand_poses(course: BodyCourse, snapshot: Snapshot) -> tuple[StandPose, ...]:
    """The course as offsets over the feet, as the robot believes to stand.

    Raises:
        UnknownFrameError: The robot has no frame of that name.
    """
    footprint_from_frame = SE3Pose.from_identity()
    if course.frame != FOOTPRINT:
        tree = frame_tree(snapshot)
        odom_from_frame = get_a_tform_b(tree, ODOM_FRAME_NAME, course.frame)
        if odom_from_frame is None:
            known = ", ".join(sorted(tree.child_to_parent_edge_map))
            raise UnknownFrameError(f"there is no frame {course.frame!r}; frames: {known}")
        footprint_from_frame = _odom_from_footprint(snapshot).inverse() * odom_from_frame
    late_s = 0.0
    if course.reference_stamp_ns is not None:
        late_s = (snapshot.robot_stamp_ns - course.reference_stamp_ns) * 1e-9
    return tuple(_stand_pose(footprint_from_frame * p.pose, p.since_reference_s - late_s) for p in course.points)


def _course(frame: str, trajectory: trajectory_pb2.SE3Trajectory) -> BodyCourse:
    if len(trajectory.points) > MAX_POINTS:
        raise InvalidCommandError(f"the body trajectory has {len(trajectory.points)} points; allowed: {MAX_POINTS}")
    points: list[CoursePoint] = []
    for point in trajectory.points:
        at, turn = point.pose.position, point.pose.rotation
        rotation = Quat(turn.w, turn.x, turn.y, turn.z) if point.pose.HasField("rotation") else Quat()
        since_s = ns_from_duration(point.time_since_reference) * 1e-9
        norm = math.hypot(rotation.w, rotation.x, rotation.y, rotation.z)
        if not all(map(math.isfinite, (at.x, at.y, at.z, norm))) or abs(norm - 1.0) > 0.1:
            raise InvalidCommandError("the body trajectory has a pose without finite position and unit quaternion")
        if not (points[-1].since_reference_s if points else 0.0) <= since_s <= MAX_DURATION_S:
            raise InvalidCommandError(f"the times of the body trajectory must rise, from 0 to {MAX_DURATION_S:g} s")
        rotation.normalize()
        points.append(CoursePoint(SE3Pose(at.x, at.y, at.z, rotation), since_s))
    reference_ns = ns_from_timestamp(trajectory.reference_time) if trajectory.HasField("reference_time") else None
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
    rotation = pose.rot
    angles = rotation.to_roll(), rotation.to_pitch(), rotation.to_yaw()
    return StandPose(pose.x, pose.y, pose.z, *angles, after_s=min(max(after_s, 0.0), MAX_DURATION_S))
