# ruff: noqa: T201 - a program prints
"""Stand and sit by wait loops and asynchronous calls of our own. Usage: low_power.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.api import basic_command_pb2, power_pb2, robot_state_pb2
from bosdyn.client.frame_helpers import BODY_FRAME_NAME, ODOM_FRAME_NAME, get_a_tform_b
from bosdyn.client.lease import LeaseClient, LeaseWallet
from bosdyn.client.license import LicenseClient
from bosdyn.client.power import PowerClient, safe_power_off_motors
from bosdyn.client.robot_command import CommandFailedErrorWithFeedback, RobotCommandBuilder, RobotCommandClient
from bosdyn.client.robot_state import RobotStateClient


def wait_for(command_client, command_id, is_done, seconds=15):
    deadline = time.time() + seconds
    while time.time() < deadline:
        feedback = command_client.robot_command_feedback_async(command_id).result()
        mobility = feedback.feedback.synchronized_feedback.mobility_command_feedback
        if mobility.status != basic_command_pb2.RobotCommandFeedbackStatus.STATUS_PROCESSING:
            raise CommandFailedErrorWithFeedback("no longer processing", feedback)
        if is_done(mobility):
            return
        time.sleep(0.05)
    raise AssertionError("waited in vain")


def main():
    robot = bosdyn.client.create_standard_sdk("LowPower").create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    robot.sync_with_directory()
    print("robot", robot.get_cached_robot_id().serial_number, "has arm:", robot.has_arm())
    print("licensed", robot.ensure_client(LicenseClient.default_service_name).get_feature_enabled(["joint_control"]))
    robot.start_time_sync()
    robot.time_sync.wait_for_sync()
    state_client = robot.ensure_client(RobotStateClient.default_service_name)
    power_client = robot.ensure_client(PowerClient.default_service_name)
    command_client = robot.ensure_client(RobotCommandClient.default_service_name)
    lease_client = robot.ensure_client(LeaseClient.default_service_name)
    lease = lease_client.acquire()
    assert isinstance(robot.lease_wallet, LeaseWallet)

    answer = power_client.power_command_async(power_pb2.PowerCommandRequest.REQUEST_ON).result()
    status, deadline = answer.status, time.time() + 15
    while status == power_pb2.STATUS_IN_PROGRESS:
        assert time.time() < deadline
        status = power_client.power_command_feedback(answer.power_command_id)
        time.sleep(0.1)
    assert status == power_pb2.STATUS_SUCCESS
    assert state_client.get_robot_state().power_state.motor_power_state == robot_state_pb2.PowerState.STATE_ON

    end_time = time.time() + 10
    stand = command_client.robot_command(
        RobotCommandBuilder.synchro_stand_command(body_height=0.02), end_time_secs=end_time, lease=None
    )
    lease_client.retain_lease(lease)
    is_standing = basic_command_pb2.StandCommand.Feedback.STATUS_IS_STANDING
    wait_for(command_client, stand, lambda mobility: mobility.stand_feedback.status == is_standing)
    frames = state_client.get_robot_state().kinematic_state.transforms_snapshot
    print("height over ground", round(get_a_tform_b(frames, "gpe", BODY_FRAME_NAME).z, 2))
    assert get_a_tform_b(frames, ODOM_FRAME_NAME, BODY_FRAME_NAME) is not None

    lease_client.retain_lease_async(lease).result()
    sit = command_client.robot_command_async(RobotCommandBuilder.synchro_sit_command()).result()
    is_sitting = basic_command_pb2.SitCommand.Feedback.STATUS_IS_SITTING
    wait_for(command_client, sit, lambda mobility: mobility.sit_feedback.status == is_sitting)
    lease_client.retain_lease(lease)
    safe_power_off_motors(command_client, state_client, timeout_sec=20, update_frequency=10)
    lease_client.return_lease(lease)
    robot.stop_time_sync()
    print("done")


if __name__ == "__main__":
    main()
