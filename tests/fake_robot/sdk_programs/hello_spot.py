# ruff: noqa: T201 - a program prints
"""Power on, stand, twist, look around, take an image, sit, power off. Usage: hello_spot.py HOSTNAME."""

import argparse
import sys
import time

import bosdyn.client
import bosdyn.client.lease
import bosdyn.client.util
import bosdyn.geometry
from bosdyn.api import trajectory_pb2
from bosdyn.api.spot import robot_command_pb2 as spot_command_pb2
from bosdyn.client.frame_helpers import GRAV_ALIGNED_BODY_FRAME_NAME, ODOM_FRAME_NAME, get_a_tform_b
from bosdyn.client.image import ImageClient
from bosdyn.client.math_helpers import Quat, SE3Pose
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient, blocking_stand
from bosdyn.client.robot_state import RobotStateClient
from bosdyn.util import seconds_to_duration


def hello_spot(config):
    bosdyn.client.util.setup_logging(config.verbose)
    sdk = bosdyn.client.create_standard_sdk("HelloSpotClient")
    robot = sdk.create_robot(config.hostname)
    bosdyn.client.util.authenticate(robot)
    robot.time_sync.wait_for_sync()
    assert not robot.is_estopped(), "Robot is estopped. Please use an external E-Stop client to configure E-Stop."

    robot_state_client = robot.ensure_client(RobotStateClient.default_service_name)
    lease_client = robot.ensure_client(bosdyn.client.lease.LeaseClient.default_service_name)
    with bosdyn.client.lease.LeaseKeepAlive(lease_client, must_acquire=True, return_at_exit=True):
        robot.logger.info("Powering on robot... This may take several seconds.")
        robot.power_on(timeout_sec=20)
        assert robot.is_powered_on(), "Robot power on failed."

        robot.logger.info("Commanding robot to stand...")
        command_client = robot.ensure_client(RobotCommandClient.default_service_name)
        blocking_stand(command_client, timeout_sec=10)

        footprint_r_body = bosdyn.geometry.EulerZXY(yaw=0.2, roll=0.0, pitch=0.0)
        command_client.robot_command(RobotCommandBuilder.synchro_stand_command(footprint_R_body=footprint_r_body))
        time.sleep(1)
        look_around(robot_state_client, command_client)

        image_client = robot.ensure_client(ImageClient.default_service_name)
        names = [source.name for source in image_client.list_image_sources()]
        (response,) = image_client.get_image_from_sources(["frontleft_fisheye_image"])
        print("image", response.source.name in names, len(response.shot.image.data) > 0)

        state = robot_state_client.get_robot_state()
        assert len(state.kinematic_state.joint_states) == 12
        print("battery", state.battery_states[0].charge_percentage.value)
        robot.operator_comment("HelloSpot tutorial user comment.")

        robot.power_off(cut_immediately=False, timeout_sec=20)
        assert not robot.is_powered_on(), "Robot power off failed."
        robot.logger.info("Robot safely powered off.")


def look_around(robot_state_client, command_client):
    """Shift the body forward, look down, and come back, by poses in the odometry frame."""
    tree = robot_state_client.get_robot_state().kinematic_state.transforms_snapshot
    odom_from_flat_body = get_a_tform_b(tree, ODOM_FRAME_NAME, GRAV_ALIGNED_BODY_FRAME_NAME)
    down = SE3Pose(0.0, 0.0, 0.0, Quat.from_pitch(0.25))
    course = [(0.6, SE3Pose(0.05, 0.0, 0.0, Quat())), (1.2, down), (1.8, SE3Pose.from_identity())]
    points = [
        trajectory_pb2.SE3TrajectoryPoint(
            pose=(odom_from_flat_body * pose).to_proto(), time_since_reference=seconds_to_duration(seconds)
        )
        for seconds, pose in course
    ]
    body_pose = spot_command_pb2.BodyControlParams.BodyPose(
        root_frame_name=ODOM_FRAME_NAME, base_offset_rt_root=trajectory_pb2.SE3Trajectory(points=points)
    )
    control = spot_command_pb2.BodyControlParams(body_pose=body_pose)
    blocking_stand(command_client, timeout_sec=10, params=spot_command_pb2.MobilityParams(body_control=control))


def main():
    parser = argparse.ArgumentParser()
    bosdyn.client.util.add_base_arguments(parser)
    options = parser.parse_args()
    hello_spot(options)
    print("done")
    return True


if __name__ == "__main__":
    if not main():
        sys.exit(1)
