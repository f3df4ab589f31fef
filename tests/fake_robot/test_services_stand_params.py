"""The body's course in a stand command: frames, times, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bosdyn.api import geometry_pb2, trajectory_pb2
from bosdyn.api.spot import robot_command_pb2 as spot_command_pb2
from bosdyn.client.math_helpers import Quat, SE3Pose
from bosdyn.client.robot_command import RobotCommandBuilder, UnknownFrameError
from bosdyn.geometry import EulerZXY
from google.protobuf.any_pb2 import Any as Packed

from fake_robot.network.status import MotorPower, Snapshot
from fake_robot.services.motion.parameters import RefusedCommandError, read_course, stand_poses

START_NS = 1_700_000_000_000_000_000
BodyControl = spot_command_pb2.BodyControlParams


@pytest.fixture
def snapshot(stub_robot_type: Any) -> Snapshot:
    """A robot that stands 4 cm behind its footprint's middle, turned by 1 rad, on ground at odom z = 0.004 m."""
    odom_from_body = Quat.from_yaw(1.0)
    feet = np.array([[0.34, 0.2, -0.48], [0.34, -0.2, -0.48], [-0.26, 0.2, -0.48], [-0.26, -0.2, -0.48]])
    return replace(
        stub_robot_type().state,
        odom_from_body_wxyz=np.array([odom_from_body.w, 0.0, 0.0, odom_from_body.z]),
        position_of_body_in_odom_m=np.array([1.0, 2.0, 0.52]),
        foot_position_in_body_m=feet,
    )


def packed(control: Any) -> Packed:
    params = Packed()
    params.Pack(spot_command_pb2.MobilityParams(body_control=control))
    return params


def point(pose: SE3Pose, at_s: float = 0.0) -> trajectory_pb2.SE3TrajectoryPoint:
    made = trajectory_pb2.SE3TrajectoryPoint(pose=pose.to_proto())
    made.time_since_reference.FromNanoseconds(round(at_s * 1e9))
    return made


def test_offsets_over_the_feet_are_taken_as_they_are(snapshot: Snapshot) -> None:
    params = RobotCommandBuilder.mobility_params(body_height=0.1, footprint_R_body=EulerZXY(roll=0.2, pitch=-0.1))
    (pose,) = stand_poses(read_course(packed(params.body_control)), snapshot)
    assert (pose.forward_m, pose.left_m, pose.height_m, pose.after_s) == (0.0, 0.0, 0.1, 0.0)
    np.testing.assert_allclose([pose.roll_rad, pose.pitch_rad, pose.yaw_rad], [0.2, -0.1, 0.0], atol=0.02)
    assert stand_poses(read_course(packed(BodyControl())), snapshot) == ()


def test_the_three_angles_are_the_attitude_that_was_asked_for(snapshot: Snapshot) -> None:
    # Quat.to_yaw is another angle: with it, this attitude is 3.5 degrees off.
    asked = Quat.from_yaw(0.5) * Quat.from_pitch(0.4) * Quat.from_roll(0.3)
    points = [point(SE3Pose(0.0, 0.0, 0.0, asked))]
    control = BodyControl(base_offset_rt_footprint=trajectory_pb2.SE3Trajectory(points=points))
    (pose,) = stand_poses(read_course(packed(control)), snapshot)
    np.testing.assert_allclose([pose.yaw_rad, pose.pitch_rad, pose.roll_rad], [0.5, 0.4, 0.3], atol=1e-9)


@pytest.mark.parametrize("frame", ["odom", "vision", "body", "flat_body"])
def test_a_pose_in_a_frame_becomes_an_offset_over_the_feet(snapshot: Snapshot, frame: str) -> None:
    # The body's own pose, wherever its frame is: 4 cm behind the middle of the feet, 4 mm below the nominal stand.
    here = {
        "odom": SE3Pose(1.0, 2.0, 0.52, Quat.from_yaw(1.0)),
        "vision": SE3Pose(3.0, 4.0, 0.5, Quat()),
    }.get(frame, SE3Pose.from_identity())
    points = [point(here, 2.5), point(here * SE3Pose(0.05, 0.0, 0.0, Quat.from_pitch(0.3)), 5.0)]
    trajectory = trajectory_pb2.SE3Trajectory(points=points)
    control = BodyControl(body_pose=BodyControl.BodyPose(root_frame_name=frame, base_offset_rt_root=trajectory))
    first, second = stand_poses(read_course(packed(control)), snapshot)
    assert (first.after_s, second.after_s) == (2.5, 5.0)
    got = [first.forward_m, first.left_m, first.height_m, first.roll_rad, first.pitch_rad, first.yaw_rad]
    np.testing.assert_allclose(got, [-0.04, 0.0, -0.004, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose([second.forward_m, second.pitch_rad], [0.01, 0.3], atol=1e-9)


def test_times_count_from_the_reference_time(snapshot: Snapshot) -> None:
    trajectory = trajectory_pb2.SE3Trajectory(points=[point(SE3Pose.from_identity(), 4.0)])
    trajectory.reference_time.FromNanoseconds(START_NS - 1_500_000_000)
    (pose,) = stand_poses(read_course(packed(BodyControl(base_offset_rt_footprint=trajectory))), snapshot)
    assert pose.after_s == pytest.approx(2.5)


@pytest.mark.parametrize(
    ("points", "told"),
    [
        ([point(SE3Pose(0.0, 0.0, math.nan, Quat()))], "without finite position"),
        ([point(SE3Pose(0.0, 0.0, 0.0, Quat(0.0, 0.0, 0.0, 0.0)))], "unit quaternion"),
        ([point(SE3Pose.from_identity(), 2.0), point(SE3Pose.from_identity(), 1.0)], "must rise"),
        ([point(SE3Pose.from_identity(), 601.0)], "to 600 s"),
        ([point(SE3Pose.from_identity())] * 1001, "1001 points; allowed: 1000"),
    ],
    ids=["not a number", "no rotation", "back in time", "too long", "too many"],
)
def test_a_course_without_sense_is_refused(points: list[Any], told: str) -> None:
    trajectory = trajectory_pb2.SE3Trajectory(points=points)
    with pytest.raises(RefusedCommandError, match=told):
        read_course(packed(BodyControl(base_offset_rt_footprint=trajectory)))


def test_params_of_another_kind_and_a_pose_without_a_frame_are_refused() -> None:
    other = Packed()
    other.Pack(geometry_pb2.Vec3())
    with pytest.raises(RefusedCommandError, match=r"bosdyn\.api\.Vec3"):
        read_course(other)
    with pytest.raises(RefusedCommandError, match="root_frame_name"):
        read_course(packed(BodyControl(body_pose=BodyControl.BodyPose())))


def test_an_unknown_frame_is_the_sdks_error(stub: Any) -> None:
    robot = stub.sdk_robot()
    robot.ensure_client("lease").acquire()
    robot.time_sync.wait_for_sync()
    stub.robot.set(motor_power=MotorPower.ON)
    pose = RobotCommandBuilder.body_pose("the moon", SE3Pose.from_identity().to_proto())
    params = spot_command_pb2.MobilityParams(body_control=BodyControl(body_pose=pose))
    with pytest.raises(UnknownFrameError) as unknown:
        robot.ensure_client("robot-command").robot_command(RobotCommandBuilder.synchro_stand_command(params=params))
    assert "frames: body, feet_center, flat_body, gpe, odom, vision" in unknown.value.response.message
    assert stub.robot.courses == []
