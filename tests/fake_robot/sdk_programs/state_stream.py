# ruff: noqa: T201 - a program prints
"""Read the state stream and look at what is in it. Usage: state_stream.py HOSTNAME."""

import itertools
import sys

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.robot_state import RobotStateStreamingClient
from bosdyn.util import timestamp_to_nsec

COUNT = 200


def main():
    sdk = bosdyn.client.create_standard_sdk("StateStream")
    sdk.register_service_client(RobotStateStreamingClient)
    robot = sdk.create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    client = robot.ensure_client(RobotStateStreamingClient.default_service_name)
    stream = client.get_robot_state_stream()
    states = [state for state, _ in zip(stream, range(COUNT), strict=False)]
    stream.cancel()
    stamps = [timestamp_to_nsec(state.joint_states.acquisition_timestamp) for state in states]
    periods = {later - earlier for earlier, later in itertools.pairwise(stamps)}
    print("periods", sorted(periods))
    assert periods == {3_000_000}
    for state in states:
        assert len(state.joint_states.position) == len(state.joint_states.load) == 12
        assert len(state.inertial_state.packets) == 3
        assert len(state.contact_states) == 4
    print("imu", states[0].inertial_state.mounting_link_name, states[0].inertial_state.packet_rate)
    print("done")


if __name__ == "__main__":
    main()
