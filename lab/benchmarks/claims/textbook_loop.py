"""A control loop as public examples are written: a peer of `spot-rl run`, for loop.py.

One thread reads the state stream, keeps the newest state and sets an event. The command stream's generator waits for
six events (333 Hz / 6), makes the observation in lists, runs the network in a session with default options and builds
a new message. A third thread switches joint control on. No limits, no checks, no log, no schedule.

`--echo` leaves the computing out: a stored message goes back on each sixth state, as quickly as gRPC can.

    python lab/benchmarks/claims/textbook_loop.py HOST:PORT --policy policies/walk.onnx --seconds 10 --out FILE
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bosdyn.client
import numpy as np
import onnxruntime
from bosdyn.api.robot_command_pb2 import JointControlStreamRequest
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.math_helpers import Quat
from bosdyn.client.robot_command import (
    RobotCommandBuilder,
    RobotCommandClient,
    RobotCommandStreamingClient,
    blocking_stand,
)
from bosdyn.client.robot_state import RobotStateStreamingClient
from bosdyn.client.util import authenticate
from bosdyn.util import seconds_to_timestamp, set_timestamp_from_now, timestamp_to_sec

from spot_model.policy.policy import load_policy
from spot_model.robot import facts

STATES_A_TICK = 6


def connect(address: str) -> Any:
    """An authenticated robot of the SDK; password and certificate from the environment."""
    sdk = bosdyn.client.create_standard_sdk("textbook", [RobotCommandStreamingClient, RobotStateStreamingClient])
    sdk.load_robot_cert(os.environ["SPOT_RL_CA_FILE"])
    host, _, port = address.rpartition(":")
    robot = sdk.create_robot(host)
    robot.update_secure_channel_port(int(port))
    authenticate(robot)
    robot.time_sync.wait_for_sync()
    return robot


class Loop:
    """The two streams and what is measured of them."""

    def __init__(self, policy_file: Path, seconds: float, *, is_echo: bool) -> None:
        policy = load_policy(policy_file)
        contract = policy.contract
        self.order = [int(i) for i in policy.policy_from_canonical]
        self.back = [int(i) for i in policy.canonical_from_policy]
        self.default, self.scale = list(contract.default_position_rad), contract.action_scale_rad
        self.kp = [contract.kp_nm_per_rad[i] for i in self.back]
        self.kd = [contract.kd_nm_s_per_rad[i] for i in self.back]
        self.session = onnxruntime.InferenceSession(str(policy_file))
        self.state: Any = None
        self.event = threading.Event()
        self.to_send: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.last_action = [0.0] * facts.N_JOINTS
        self.seconds, self.is_echo = seconds, is_echo
        self.key = 0
        self.is_over = self.is_sending = False
        self.compute_s: list[float] = []
        self.triggers: dict[int, int] = {}
        self.receipts: dict[int, int] = {}

    # States ----------------------------------------------------------------------------------------------------------

    def read_states(self, client: RobotStateStreamingClient) -> None:
        """The state thread."""
        for count, state in enumerate(client.get_robot_state_stream(), start=1):
            if self.is_over:
                return
            last = state.last_command
            self.receipts.setdefault(last.user_command_key, last.received_timestamp.ToNanoseconds())
            self.state = state
            if not self.is_echo:
                self.event.set()
            elif count % STATES_A_TICK == 0:
                self.to_send.put(state)

    # Commands --------------------------------------------------------------------------------------------------------

    def commands(self) -> Iterator[JointControlStreamRequest]:
        """The generator that the command stream reads."""
        end_s = time.monotonic() + self.seconds
        stored = self.message([self.default[i] for i in self.back])
        while time.monotonic() < end_s:
            if self.is_echo:
                state, self.key, request = self.to_send.get(timeout=1.0), self.key + 1, stored
                self.stamp(stored, state)
            else:
                for _ in range(STATES_A_TICK):
                    if not self.event.wait(1.0):
                        return
                    self.event.clear()
                begin_s, state, self.key = time.perf_counter(), self.state, self.key + 1
                request = self.tick(state)
                self.compute_s.append(time.perf_counter() - begin_s)
            self.triggers[self.key] = state.joint_states.acquisition_timestamp.ToNanoseconds()
            yield request
            self.is_sending = True

    def tick(self, state: Any) -> JointControlStreamRequest:
        """Observation, network, message."""
        kinematics = state.kinematic_state
        rotation, velocity = kinematics.odom_tform_body.rotation, kinematics.velocity_of_body_in_odom
        into_body = Quat(rotation.w, rotation.x, rotation.y, rotation.z).inverse()
        position, speed = list(state.joint_states.position), list(state.joint_states.velocity)
        observation = list(into_body.transform_point(velocity.linear.x, velocity.linear.y, velocity.linear.z))
        observation += into_body.transform_point(velocity.angular.x, velocity.angular.y, velocity.angular.z)
        observation += into_body.transform_point(0.0, 0.0, -1.0)
        observation += [0.0, 0.0, 0.0]
        observation += [position[joint] - default for joint, default in zip(self.order, self.default, strict=True)]
        observation += [speed[joint] for joint in self.order]
        observation += self.last_action
        batch = np.array([observation]).astype(np.float32)
        self.last_action = self.session.run(None, {self.session.get_inputs()[0].name: batch})[0].tolist()[0]
        ramp = min(0.1 * self.key, 1.0)
        target = [d + ramp * self.scale * a for d, a in zip(self.default, self.last_action, strict=True)]
        request = self.message([target[i] for i in self.back])
        self.stamp(request, state)
        return request

    def message(self, position_rad: list[float]) -> JointControlStreamRequest:
        """A new message with every field but its stamps."""
        request = JointControlStreamRequest()
        request.header.client_name = "textbook"
        command = request.joint_command
        command.gains.k_q_p.extend(self.kp)
        command.gains.k_qd_p.extend(self.kd)
        command.position.extend(position_rad)
        command.velocity.extend([0.0] * facts.N_JOINTS)
        command.load.extend([0.0] * facts.N_JOINTS)
        command.extrapolation_duration.nanos = 5_000_000
        return request

    def stamp(self, request: JointControlStreamRequest, state: Any) -> None:
        """Key, and the end 100 ms after the state."""
        set_timestamp_from_now(request.header.request_timestamp)
        end_s = timestamp_to_sec(state.joint_states.acquisition_timestamp) + 0.1
        request.joint_command.end_time.CopyFrom(seconds_to_timestamp(end_s))
        request.joint_command.user_command_key = self.key

    def run(self, robot: Any) -> str:
        """Stand up, stream, sit down; returns the name of the command stream's status."""
        with LeaseKeepAlive(robot.ensure_client(LeaseClient.default_service_name), must_acquire=True):
            robot.power_on(timeout_sec=20)
            commander = robot.ensure_client(RobotCommandClient.default_service_name)
            blocking_stand(commander, timeout_sec=20)
            states = robot.ensure_client(RobotStateStreamingClient.default_service_name)
            threading.Thread(target=self.read_states, args=(states,), daemon=True).start()
            while self.state is None:
                time.sleep(0.01)
            threading.Thread(target=self.activate, args=(commander,), daemon=True).start()
            stream = robot.ensure_client(RobotCommandStreamingClient.default_service_name)
            answer = stream.send_joint_control_commands(self.commands())
            time.sleep(0.02)
            self.is_over = True
            robot.power_off(cut_immediately=False, timeout_sec=20)
        return str(type(answer).Status.Name(answer.status))

    def activate(self, commander: RobotCommandClient) -> None:
        """Switch joint control on once commands flow."""
        while not self.is_sending:
            time.sleep(0.001)
        commander.robot_command(RobotCommandBuilder.joint_command())


def main() -> None:
    """Run once and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("address")
    parser.add_argument("--policy", type=Path, default=Path("policies/walk.onnx"))
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--fifo", type=int, default=0, help="SCHED_FIFO priority; 0: none")
    parser.add_argument("--cpus", type=int, nargs="*", default=[])
    parser.add_argument("--echo", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    if chosen.fifo:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(chosen.fifo))
    if chosen.cpus:
        os.sched_setaffinity(0, chosen.cpus)
    loop = Loop(chosen.policy, chosen.seconds, is_echo=chosen.echo)
    status = loop.run(connect(chosen.address))
    first_ns = min(loop.triggers.values())
    ticks = [
        (trigger - first_ns, loop.receipts[key] - first_ns if key in loop.receipts else float("nan"))
        for key, trigger in loop.triggers.items()
    ]
    chosen.out.write_text(json.dumps({"status": status, "compute_s": loop.compute_s, "ticks": ticks}))


if __name__ == "__main__":
    main()
