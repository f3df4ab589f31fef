# ruff: noqa: T201 - a program prints
"""Ask for the clock by each of the SDK's ways, then right, freeze, stop and sit. Usage: inspector.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.data_acquisition import DataAcquisitionClient
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.robot_command import (
    RobotCommandBuilder,
    RobotCommandClient,
    blocking_selfright,
    blocking_sit,
    blocking_stand,
)
from bosdyn.client.time_sync import NotEstablishedError, TimeSyncClient, TimeSyncEndpoint, TimeSyncThread


def clocks(robot):
    endpoint = TimeSyncEndpoint(robot.ensure_client(TimeSyncClient.default_service_name))
    try:
        endpoint.get_robot_time_converter()
    except NotEstablishedError:
        print("no clock yet")
    assert endpoint.establish_timesync(max_samples=20, break_on_success=True)
    converter = endpoint.get_robot_time_converter()
    now = time.time()
    robot_now = converter.robot_seconds_from_local_seconds(now)
    there = converter.robot_timestamp_from_local_secs(now)
    assert abs(converter.local_seconds_from_robot_timestamp(there) - now) < 1e-3
    print("clock id", bool(endpoint.clock_identifier), "skew sign", "-" if robot_now < now else "+")
    thread = TimeSyncThread(robot.ensure_client(TimeSyncClient.default_service_name))
    thread.start()
    thread.wait_for_sync(timeout_sec=10)
    assert thread.has_established_time_sync
    assert not thread.stopped
    thread.stop()
    assert thread.stopped


def main():
    robot = bosdyn.client.create_standard_sdk("Inspector").create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    capabilities = robot.ensure_client(DataAcquisitionClient.default_service_name).get_service_info()
    print("can capture", [(s.service_name, len(s.image_source_names)) for s in capabilities.image_sources])
    commands = robot.ensure_client(RobotCommandClient.default_service_name)
    clocks(robot)
    robot.time_sync.wait_for_sync()
    with LeaseKeepAlive(robot.ensure_client(LeaseClient.default_service_name), must_acquire=True, return_at_exit=True):
        robot.power_on(timeout_sec=20)
        blocking_selfright(commands, timeout_sec=20)
        blocking_stand(commands, timeout_sec=10)
        commands.robot_command(RobotCommandBuilder.freeze_command())
        commands.robot_command(RobotCommandBuilder.stop_command())
        blocking_sit(commands, timeout_sec=15)
        commands.robot_command(RobotCommandBuilder.safe_power_off_command())
        deadline = time.time() + 20
        while robot.is_powered_on():
            assert time.time() < deadline
            time.sleep(0.1)
    print("done")


if __name__ == "__main__":
    main()
