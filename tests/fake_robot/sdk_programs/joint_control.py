# ruff: noqa: T201 - a program prints
"""Hold a stand by joint control, in either order of opening the stream and activating it.

Usage: joint_control.py HOSTNAME stream-first|activate-first
"""

import sys
import threading
import time

import bosdyn.client
import bosdyn.client.util
import grpc
from bosdyn.api import robot_command_pb2
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.robot_command import (
    RobotCommandBuilder,
    RobotCommandClient,
    RobotCommandStreamingClient,
    blocking_sit,
    blocking_stand,
)
from bosdyn.client.robot_state import RobotStateStreamingClient
from bosdyn.util import now_timestamp, seconds_to_duration, seconds_to_timestamp

KP = [624, 936, 286] * 4
KD = [5.20, 5.20, 2.04] * 4
HOLD_SECONDS_AT_MOST = 60.0
# A robot on which this program must stay in control although the computer stalls: far beyond what a person would allow.
END_SECONDS_AHEAD = 8.0


class StateReader:
    """Reads the state stream on a thread of its own and keeps the newest message."""

    def __init__(self, client):
        self._stream = client.get_robot_state_stream()
        self._condition = threading.Condition()
        self.latest = None
        self.count = 0
        self.ended_with = None
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        try:
            for state in self._stream:
                with self._condition:
                    self.latest = state
                    self.count += 1
                    self._condition.notify_all()
        except grpc.RpcError as error:
            self.ended_with = error.code()

    def wait_for_newer(self, count):
        with self._condition:
            assert self._condition.wait_for(lambda: self.count > count, timeout=10), "no state arrives"
            return self.count, self.latest

    def stop(self):
        self._stream.cancel()
        self._thread.join(10)


class Commander:
    """Makes a joint command for every state: hold the pose of the first one."""

    def __init__(self, robot, reader):
        self._robot = robot
        self._reader = reader
        self.stopping = threading.Event()
        self.started = threading.Event()
        self.sent = 0
        self.echoed = 0

    def requests(self):
        count, state = self._reader.wait_for_newer(0)
        pose = list(state.joint_states.position)
        while not self.stopping.is_set():
            request = robot_command_pb2.JointControlStreamRequest()
            request.header.client_name = "joint_control"
            request.header.request_timestamp.CopyFrom(now_timestamp())
            command = request.joint_command
            command.end_time.CopyFrom(
                self._robot.time_sync.robot_timestamp_from_local_secs(time.time() + END_SECONDS_AHEAD)
            )
            command.extrapolation_duration.CopyFrom(seconds_to_duration(0.005))
            command.position.extend(pose)
            command.velocity.extend([0.0] * 12)
            command.load.extend([0.0] * 12)
            if self.sent == 0:
                command.gains.k_q_p.extend(KP)
                command.gains.k_qd_p.extend(KD)
            self.sent += 1
            command.user_command_key = self.sent
            yield request
            self.started.set()
            count, state = self._reader.wait_for_newer(count)
            key = state.last_command.user_command_key
            # Until the first command arrives, the robot echoes whatever a program before this one sent.
            self.echoed = max(self.echoed, key) if key <= self.sent else self.echoed


def main():
    hostname, order = sys.argv[1], sys.argv[2]
    sdk = bosdyn.client.create_standard_sdk("JointControl", [RobotStateStreamingClient, RobotCommandStreamingClient])
    robot = sdk.create_robot(hostname)
    bosdyn.client.util.authenticate(robot)
    robot.time_sync.wait_for_sync()
    assert seconds_to_timestamp(1).seconds == seconds_to_duration(1).seconds

    command_client = robot.ensure_client(RobotCommandClient.default_service_name)
    streaming_client = robot.ensure_client(RobotCommandStreamingClient.default_service_name)
    state_client = robot.ensure_client(RobotStateStreamingClient.default_service_name)
    lease_client = robot.ensure_client(LeaseClient.default_service_name)

    with LeaseKeepAlive(lease_client, must_acquire=True, return_at_exit=True):
        robot.power_on(timeout_sec=20)
        blocking_stand(command_client, timeout_sec=10)
        reader = StateReader(state_client)
        commander = Commander(robot, reader)
        verdicts = []

        def stream():
            verdicts.append(streaming_client.send_joint_control_commands(commander.requests()))

        thread = threading.Thread(target=stream, daemon=True)
        if order == "stream-first":
            thread.start()
            assert commander.started.wait(10)
            command_client.robot_command(RobotCommandBuilder.joint_command())
        else:
            command_client.robot_command(RobotCommandBuilder.joint_command())
            thread.start()
        deadline = time.time() + HOLD_SECONDS_AT_MOST
        while commander.echoed <= 100 and time.time() < deadline:
            time.sleep(0.05)
        feedback = command_client.robot_command_feedback().feedback.full_body_feedback
        assert feedback.joint_feedback.status == feedback.joint_feedback.STATUS_ACTIVE, feedback
        height = reader.latest.kinematic_state.odom_tform_body.position.z
        print("echoed", commander.echoed, "of", commander.sent, "body z", round(height, 3))
        assert commander.echoed > 100
        command_client.robot_command(RobotCommandBuilder.synchro_stand_command())
        commander.stopping.set()
        thread.join(10)
        print("verdict", robot_command_pb2.JointControlStreamResponse.Status.Name(verdicts[0].status))
        blocking_stand(command_client, timeout_sec=10)
        blocking_sit(command_client, timeout_sec=10)
        robot.power_off(cut_immediately=False, timeout_sec=20)
        reader.stop()
    print("done")


if __name__ == "__main__":
    main()
