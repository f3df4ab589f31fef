# ruff: noqa: T201 - a program prints
"""Power on, stand, twist, stand tall, sit, power off: what a first program does. Usage: hello_spot.py HOSTNAME."""

import argparse
import sys
import time

import bosdyn.client
import bosdyn.client.lease
import bosdyn.client.util
import bosdyn.geometry
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient, blocking_stand
from bosdyn.client.robot_state import RobotStateClient


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
        command_client.robot_command(RobotCommandBuilder.synchro_stand_command(body_height=0.05))
        time.sleep(1)

        state = robot_state_client.get_robot_state()
        assert len(state.kinematic_state.joint_states) == 12
        print("battery", state.battery_states[0].charge_percentage.value)
        robot.operator_comment("HelloSpot tutorial user comment.")

        robot.power_off(cut_immediately=False, timeout_sec=20)
        assert not robot.is_powered_on(), "Robot power off failed."
        robot.logger.info("Robot safely powered off.")


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
