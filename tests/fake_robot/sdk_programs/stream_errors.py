# ruff: noqa: T201 - a program prints
"""Joint-control streams as beginners send them, and what the robot says to each. Usage: stream_errors.py HOSTNAME."""

import sys
import threading
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.api import robot_command_pb2
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.robot_command import (
    RobotCommandBuilder,
    RobotCommandClient,
    RobotCommandStreamingClient,
    blocking_sit,
    blocking_stand,
)
from bosdyn.client.robot_state import RobotStateClient

Status = robot_command_pb2.JointControlStreamResponse.Status


class Stream:
    """One try after another, each on a stream of its own."""

    def __init__(self, robot):
        self._robot = robot
        self._client = robot.ensure_client(RobotCommandStreamingClient.default_service_name)
        self._state = robot.ensure_client(RobotStateClient.default_service_name)

    def request(self, key, ahead_s=0.2, gains=True, joints=12):
        pose = [j.position.value for j in self._state.get_robot_state().kinematic_state.joint_states]
        request = robot_command_pb2.JointControlStreamRequest()
        command = request.joint_command
        command.user_command_key = key
        command.end_time.CopyFrom(self._robot.time_sync.robot_timestamp_from_local_secs(time.time() + ahead_s))
        command.position.extend(pose[:joints])
        command.velocity.extend([0.0] * joints)
        command.load.extend([0.0] * joints)
        if gains:
            command.gains.k_q_p.extend([500.0] * joints)
            command.gains.k_qd_p.extend([5.0] * joints)
        return request

    def send(self, requests):
        response = self._client.send_joint_control_commands(requests)
        return Status.Name(response.status)

    def holding(self, seconds, **changes):
        key, end = 0, time.time() + seconds
        while time.time() < end:
            key += 1
            yield self.request(key, gains=key == 1, **changes)
            time.sleep(0.02)


def activate(commands):
    commands.robot_command(RobotCommandBuilder.joint_command())


def main():
    sdk = bosdyn.client.create_standard_sdk("StreamErrors", [RobotCommandStreamingClient])
    robot = sdk.create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    robot.time_sync.wait_for_sync()
    commands = robot.ensure_client(RobotCommandClient.default_service_name)
    stream = Stream(robot)
    with LeaseKeepAlive(robot.ensure_client(LeaseClient.default_service_name), must_acquire=True, return_at_exit=True):
        robot.power_on(timeout_sec=20)
        blocking_stand(commands, timeout_sec=10)

        print("no gains:", stream.send(iter([stream.request(1, gains=False)])))
        print("eleven joints:", stream.send(iter([stream.request(1, joints=11)])))
        print("without a key:", stream.send(iter([stream.request(0)])))
        print("already over:", stream.send(iter([stream.request(1, ahead_s=-0.5)])))
        print("never activated:", stream.send(stream.holding(20.0)))
        print("nothing at all:", stream.send(iter([])))

        # A stream that pauses for longer than its commands last; the robot then does as it is set to.
        activate(commands)
        print("fell silent:", stream.send(paused(stream)))
        blocking_stand(commands, timeout_sec=15)

        # Another command takes the joints away from an open stream, and a new stream gets them again.
        for _ in range(2):
            verdicts = []
            thread = threading.Thread(target=lambda: verdicts.append(stream.send(stream.holding(0.8))))  # noqa: B023
            thread.start()
            time.sleep(0.3)
            activate(commands)
            time.sleep(0.3)
            blocking_stand(commands, timeout_sec=10)
            thread.join(20)
            print("taken away:", verdicts[0])
        blocking_sit(commands, timeout_sec=10)
        robot.power_off(cut_immediately=False, timeout_sec=20)
    print("done")


def paused(stream):
    yield from stream.holding(0.4)
    time.sleep(0.6)
    yield stream.request(1000)


if __name__ == "__main__":
    main()
