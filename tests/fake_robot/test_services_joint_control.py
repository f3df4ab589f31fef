"""Every verdict of a joint-control stream, through the SDK's client, on the simulated robot in lock-step."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bosdyn.api import power_pb2, robot_command_pb2
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandStreamingClient
from bosdyn.client.robot_state import RobotStateStreamingClient

from fake_robot.pytest_plugin import FakeSpot, running_fake_spot
from spot_protos import fake_admin_pb2

Verdict = robot_command_pb2.JointControlStreamResponse
Request = robot_command_pb2.JointControlStreamRequest


class StandingRobot:
    """A lock-step robot that stands, and a joint-control stream to it that a test feeds one request at a time."""

    def __init__(self, spot: FakeSpot, admin: Any) -> None:
        self.admin = admin
        self.robot = spot.sdk_robot(RobotCommandStreamingClient, RobotStateStreamingClient)
        self.robot.time_sync.wait_for_sync(timeout_sec=20)
        self.robot.ensure_client("lease").take()
        self.commands = self.robot.ensure_client("robot-command")
        self._requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.key = self.status().last_command_key
        self.pose: list[float] = []

    def status(self) -> Any:
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    def pass_s(self, seconds: float, *, after_key: int = 0) -> None:
        request = fake_admin_pb2.StepRequest(duration_ns=round(seconds * 1e9), wait_for_command_key=after_key)
        self.admin.Step(request)

    def stand(self) -> None:
        for fault in self.robot.ensure_client("robot-state").get_robot_state().behavior_fault_state.faults:
            self.commands.clear_behavior_fault(fault.behavior_fault_id)
        self.robot.ensure_client("power").power_command(power_pb2.PowerCommandRequest.REQUEST_ON)
        if self.status().motor_power != "on":
            self.pass_s(0.6)
        self.commands.robot_command(RobotCommandBuilder.synchro_stand_command())
        self.pass_s(1.5)
        joints = self.robot.ensure_client("robot-state").get_robot_state().kinematic_state.joint_states
        self.pose = [joint.position.value for joint in joints]

    def activate(self) -> None:
        self.commands.robot_command(RobotCommandBuilder.joint_command())

    def open_stream(self) -> None:
        client = self.robot.ensure_client("robot-command-streaming")

        def call() -> None:
            self._answers.put(client.send_joint_control_commands(iter(self._requests.get, None)))

        threading.Thread(target=call, daemon=True).start()

    def request(self, *, end_in_s: float = 0.1, has_gains: bool = True) -> Any:
        self.key += 1
        request = Request()
        command = request.joint_command
        command.end_time.FromNanoseconds(self.status().robot_stamp_ns + round(end_in_s * 1e9))
        command.position.extend(self.pose)
        command.velocity.extend([0.0] * 12)
        command.load.extend([0.0] * 12)
        command.user_command_key = self.key
        if has_gains:
            command.gains.k_q_p.extend([624.0, 936.0, 286.0] * 4)
            command.gains.k_qd_p.extend([5.2, 5.2, 2.04] * 4)
        return request

    def send(self, request: Any) -> None:
        self._requests.put(request)

    def end_stream(self) -> None:
        self._requests.put(None)

    def verdict(self) -> tuple[str, str]:
        answer = self._answers.get(timeout=20)
        self._requests.put(None)
        return Verdict.Status.Name(answer.status), answer.message


@pytest.fixture(scope="module")
def spot(fake_spot_state_folder: Path) -> Iterator[FakeSpot]:
    scenario = {
        "services": {"lease_timeout_s": 3600.0},  # nothing keeps the lease alive here, and a busy computer is slow
        "power": {"power_on_s": 0.4},
        "motion": {"stand_s": 0.8},
        "joint_control": {"activation_wait_s": 1.0},
    }
    with running_fake_spot(scenario=scenario, lock_step=True, state_folder=fake_spot_state_folder) as spot:
        yield spot


@pytest.fixture
def standing(spot: FakeSpot) -> Iterator[StandingRobot]:
    with spot.admin() as admin:
        standing = StandingRobot(spot, admin)
        standing.stand()
        yield standing
        standing.end_stream()
        standing.robot.stop_time_sync()


@pytest.mark.parametrize("is_stream_first", [True, False])
def test_both_orders_and_a_clean_end(standing: StandingRobot, is_stream_first: bool) -> None:
    standing.open_stream()
    if not is_stream_first:
        standing.activate()
    for index in range(20):
        standing.send(standing.request(has_gains=index == 0))
        standing.pass_s(0.02, after_key=standing.key)
        if index == 0 and is_stream_first:
            standing.activate()
    assert standing.status().mode == "joint_control"
    assert standing.status().commands_received >= 19
    standing.commands.robot_command(RobotCommandBuilder.synchro_stand_command())
    standing.end_stream()
    assert standing.verdict() == ("STATUS_OK", "")
    standing.pass_s(1.5)
    assert standing.status().mode == "standing"


def broken(change: Callable[[Any], None]) -> Callable[[StandingRobot], Any]:
    def make(standing: StandingRobot) -> Any:
        request = standing.request()
        change(request.joint_command)
        return request

    return make


@pytest.mark.parametrize(
    ("make", "status", "words"),
    [
        (lambda s: s.request(end_in_s=-0.01), "STATUS_EXPIRED", ""),
        (lambda s: s.request(end_in_s=60.0), "STATUS_TOO_DISTANT", ""),
        (lambda s: s.request(has_gains=False), "STATUS_INVALID_REQUEST", "gains"),
        (broken(lambda c: c.ClearField("end_time")), "STATUS_INVALID_REQUEST", "end_time"),
        (broken(lambda c: c.position.pop()), "STATUS_INVALID_REQUEST", "position"),
        (broken(lambda c: c.position.__setitem__(3, float("nan"))), "STATUS_INVALID_REQUEST", "position"),
    ],
    ids=["expired", "too distant", "no gains", "no end time", "eleven joints", "not a number"],
)
def test_a_bad_first_command_ends_the_stream(
    standing: StandingRobot, make: Callable[[StandingRobot], Any], status: str, words: str
) -> None:
    standing.open_stream()
    standing.activate()
    standing.send(make(standing))
    for _ in range(100):  # the command's way takes host time, its delay and its judgement robot time
        standing.pass_s(0.01)
    got, message = standing.verdict()
    assert got == status
    assert words in message
    assert message


def test_a_stream_that_nobody_activates_is_inactive(standing: StandingRobot) -> None:
    standing.open_stream()
    for _ in range(20):
        standing.send(standing.request(end_in_s=5.0))
        standing.pass_s(0.02, after_key=standing.key)
    for _ in range(12):  # the scenario's wait is 1 s
        standing.pass_s(0.1)
    status, message = standing.verdict()
    assert status == "STATUS_INACTIVE"
    assert "joint control" in message or "joint-control" in message


def test_silence_voids_the_last_command(standing: StandingRobot) -> None:
    standing.open_stream()
    standing.activate()
    standing.send(standing.request(end_in_s=0.1))
    standing.pass_s(0.02, after_key=standing.key)
    assert standing.status().mode == "joint_control"
    standing.pass_s(1.0)
    assert standing.status().mode == "damping"
    status, message = standing.verdict()
    assert status == "STATUS_EXPIRED"
    assert message


def test_the_estop_ends_joint_control(standing: StandingRobot) -> None:
    standing.open_stream()
    standing.activate()
    standing.send(standing.request(end_in_s=1.0))
    standing.pass_s(0.02, after_key=standing.key)
    fault = standing.admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name="estop_pressed"))
    standing.pass_s(0.5)
    assert standing.status().motor_power == "off"
    assert standing.verdict()[0] == "STATUS_INACTIVE"
    standing.admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest(fault_ids=[fault.fault_id]))
