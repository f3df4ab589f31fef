# ruff: noqa: T201 - a program prints
"""How far the robot's clock is from ours, by each of the SDK's ways. Usage: time_sync.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.robot_state import RobotStateClient
from bosdyn.client.time_sync import TimeSyncClient, TimeSyncEndpoint
from bosdyn.util import duration_to_seconds, timestamp_to_sec


def main():
    robot = bosdyn.client.create_standard_sdk("TimeSync").create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    endpoint = TimeSyncEndpoint(robot.ensure_client(TimeSyncClient.default_service_name))
    assert endpoint.establish_timesync(max_samples=10)
    skew = duration_to_seconds(endpoint.clock_skew)
    print("skew", round(skew, 1), "s, round trip", round(duration_to_seconds(endpoint.round_trip_time) * 1e3, 1), "ms")
    robot.start_time_sync(1.0)
    robot.time_sync.wait_for_sync()
    other = duration_to_seconds(robot.time_sync.get_robot_clock_skew(timesync_timeout_sec=3))
    assert abs(other - skew) < 5.0, (other, skew)
    state = robot.ensure_client(RobotStateClient.default_service_name).get_robot_state()
    stamp = timestamp_to_sec(state.kinematic_state.acquisition_timestamp)
    assert abs(robot.time_sec() - stamp) < 5.0
    converter = robot.time_sync.get_robot_time_converter()
    assert abs(timestamp_to_sec(converter.robot_timestamp_from_local_secs(time.time())) - stamp) < 5.0
    robot.stop_time_sync()
    print("done")


if __name__ == "__main__":
    main()
