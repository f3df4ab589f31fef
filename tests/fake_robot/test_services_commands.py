"""Lease, e-stop, power, motions and joint-control streams through the SDK's own clients, on a robot without physics."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import pytest
from bosdyn.api import arm_command_pb2, basic_command_pb2, robot_command_pb2, synchronized_command_pb2
from bosdyn.client import power
from bosdyn.client.estop import EstopEndpoint, EstopKeepAlive, MotorsOnError, StopLevel
from bosdyn.client.exceptions import InvalidRequestError, LeaseUseError, ResponseError
from bosdyn.client.lease import LeaseKeepAlive, ResourceAlreadyClaimedError
from bosdyn.client.power import EstoppedError, FaultedError, OverriddenError
from bosdyn.client.robot_command import (
    BehaviorFaultError,
    NotClearedError,
    NotPoweredOnError,
    RobotCommandBuilder,
    RobotCommandStreamingClient,
    UnsupportedError,
)
from bosdyn.client.robot_state import RobotStateStreamingClient
from bosdyn.geometry import EulerZXY

from fake_robot.network.status import EstopLevel, Mode, MotorPower

Status = robot_command_pb2.JointControlStreamResponse
Stand = basic_command_pb2.StandCommand.Feedback


@pytest.fixture
def robot(stub: Any) -> Iterator[Any]:
    """An authenticated robot of the SDK with the lease, the motors on, and time-sync."""
    robot = stub.sdk_robot(RobotStateStreamingClient, RobotCommandStreamingClient)
    robot.ensure_client("lease").acquire()
    stub.robot.set(motor_power=MotorPower.ON, mode=Mode.SITTING)
    robot.time_sync.wait_for_sync(timeout_sec=10)
    yield robot
    robot.stop_time_sync()


@pytest.fixture
def commands(robot: Any) -> Any:
    """The robot-command client."""
    return robot.ensure_client("robot-command")


# ----------------------------------------------------------------------------------------------------------- lease


def test_two_clients_fight_for_the_lease(stub: Any) -> None:
    first, second = stub.sdk_robot(), stub.sdk_robot()
    first.ensure_client("lease").acquire()
    with pytest.raises(ResourceAlreadyClaimedError) as claimed:
        second.ensure_client("lease").acquire()
    assert claimed.value.response.lease_owner.client_name.startswith("test")
    second.ensure_client("lease").take()
    stub.robot.set(motor_power=MotorPower.ON)
    with pytest.raises(LeaseUseError) as refused:
        power.power_off_motors(first.ensure_client("power"), timeout_sec=5)
    assert refused.value.lease_use_result.status == refused.value.lease_use_result.STATUS_OLDER
    assert stub.robot.calls.count("power_off") == 0
    power.power_off_motors(second.ensure_client("power"), timeout_sec=5)
    assert stub.robot.calls.count("power_off") == 1


def test_keep_alive_returns_the_lease(stub: Any) -> None:
    client = stub.sdk_robot().ensure_client("lease")
    with LeaseKeepAlive(client, must_acquire=True, return_at_exit=True):
        (everything, body, mobility) = client.list_leases(include_full_lease_info=True)
        assert everything.resource == "all-leases"
        assert body.resource == "body"
        assert body.lease_owner.client_name
        assert mobility.resource == "mobility"
    assert not client.list_leases()[0].lease_owner.client_name
    assert client.list_leases_full().resource_tree.sub_resources[0].resource == "mobility"


@pytest.mark.parametrize(
    ("policy", "call"), [("safe_power_off", ["safe_power_off"]), ("stop", ["stop_motion"]), ("nothing", [])]
)
def test_what_happens_when_a_lease_expires(serve_stub: Callable[..., Any], policy: str, call: list[str]) -> None:
    stub = serve_stub(on_lease_expiry=policy, lease_timeout_s=6.0)
    client = stub.sdk_robot().ensure_client("lease")
    client.acquire()
    stub.robot.set(motor_power=MotorPower.ON)
    stub.robot.clock.pass_s(6.5)
    stub.server.world.tick()
    stub.server.world.tick()
    assert [c for c in stub.robot.calls if c in {"safe_power_off", "stop_motion"}] == call


def test_setting_the_robots_clock_neither_ends_nor_prolongs_a_lease(stub: Any) -> None:
    client = stub.sdk_robot().ensure_client("lease")
    lease = client.acquire()
    stub.robot.clock.jump_s(1000.0)
    stub.server.world.tick()
    client.retain_lease(lease)
    stub.robot.clock.jump_s(-1000.0)
    stub.robot.clock.pass_s(6.5)
    with pytest.raises(LeaseUseError):
        client.retain_lease(lease)


# ---------------------------------------------------------------------------------------------------------- e-stop


def test_estop_program(serve_stub: Callable[..., Any]) -> None:
    stub = serve_stub(operator_estop=False)
    robot = stub.sdk_robot()
    client = robot.ensure_client("estop")
    assert robot.is_estopped()
    endpoint = EstopEndpoint(client, "program", estop_timeout=9.0)
    endpoint.force_simple_setup()
    with EstopKeepAlive(endpoint) as keep_alive:
        keep_alive.allow()
        assert not robot.is_estopped()
        assert stub.robot.calls[-1] == "estop none"
        keep_alive.settle_then_cut()
        assert client.get_status().stop_level == StopLevel.ESTOP_LEVEL_SETTLE_THEN_CUT
        assert stub.robot.calls[-1] == "estop settle_then_cut"
        keep_alive.stop()
        assert stub.robot.calls[-1] == "estop cut"
        keep_alive.allow()
        assert client.get_status_async().result().endpoints[0].endpoint.name == "program"
        stub.robot.set(motor_power=MotorPower.ON)
        with pytest.raises(MotorsOnError):
            client.set_config(client.get_config(), client.get_config().unique_id)
        stub.robot.set(motor_power=MotorPower.OFF)
    endpoint.deregister()
    assert robot.is_estopped()


def test_the_operators_estop_can_be_replaced(stub: Any) -> None:
    robot = stub.sdk_robot()
    assert not robot.is_estopped()
    endpoint = EstopEndpoint(robot.ensure_client("estop"), "program", estop_timeout=9.0)
    endpoint.force_simple_setup()
    assert robot.is_estopped()
    endpoint.allow()
    assert not robot.is_estopped()
    stub.robot.clock.pass_s(9.5)
    stub.server.world.tick()
    assert stub.robot.calls[-1] == "estop settle_then_cut"


# ----------------------------------------------------------------------------------------------------------- power


def test_power_on_waits_until_the_motors_are_on(stub: Any) -> None:
    robot = stub.sdk_robot()
    robot.ensure_client("lease").acquire()
    threading.Timer(0.3, lambda: stub.robot.set(motor_power=MotorPower.ON)).start()
    robot.power_on(timeout_sec=20, update_frequency=20)
    assert stub.robot.calls.count("power_on") == 1
    robot.power_on(timeout_sec=20)  # already on
    assert stub.robot.calls.count("power_on") == 1
    robot.power_off(cut_immediately=True, timeout_sec=20, update_frequency=20)
    assert not robot.is_powered_on()


def test_power_on_is_refused_for_a_reason(stub: Any) -> None:
    robot = stub.sdk_robot()
    robot.ensure_client("lease").acquire()
    stub.server.world.estop.press_elsewhere(is_pressed=True)
    with pytest.raises(EstoppedError):
        robot.power_on()
    stub.server.world.estop.press_elsewhere(is_pressed=False)
    stub.robot.set(is_battery_missing=True)
    with pytest.raises(power.BatteryMissingError):
        robot.power_on()
    stub.robot.set(is_battery_missing=False)
    stub.robot.add_system_fault("battery_dead", "critical")
    with pytest.raises(FaultedError) as refused:
        robot.power_on()
    assert refused.value.response.blocking_faults[0].name == "battery_dead"
    assert "power_on" not in stub.robot.calls


def test_a_cut_while_powering_on_is_told(stub: Any) -> None:
    robot = stub.sdk_robot()
    robot.ensure_client("lease").acquire()
    threading.Timer(0.3, stub.robot.power_off).start()
    with pytest.raises(OverriddenError):
        robot.power_on(timeout_sec=20, update_frequency=20)


# --------------------------------------------------------------------------------------------------------- motions


@pytest.mark.parametrize(
    ("command", "call"),
    [
        (RobotCommandBuilder.synchro_stand_command(), "stand 0.00 0.00 0.00"),
        (
            RobotCommandBuilder.synchro_stand_command(body_height=0.1, footprint_R_body=EulerZXY(roll=0.2)),
            "stand 0.10 0.20 0.00",
        ),
        (RobotCommandBuilder.synchro_sit_command(), "sit"),
        (RobotCommandBuilder.stop_command(), "stop_motion"),
        (RobotCommandBuilder.freeze_command(), "freeze"),
        (RobotCommandBuilder.selfright_command(), "selfright"),
        (RobotCommandBuilder.safe_power_off_command(), "safe_power_off"),
        (RobotCommandBuilder.joint_command(), "enter_joint_control"),
        (
            RobotCommandBuilder.build_synchro_command(RobotCommandBuilder.synchro_stand_command()),
            "stand 0.00 0.00 0.00",
        ),
    ],
)
def test_commands_reach_the_robot(commands: Any, stub: Any, command: Any, call: str) -> None:
    number = commands.robot_command(command)
    assert stub.robot.calls[-1] == call
    assert commands.robot_command_async(command).result() > number
    commands.robot_command_feedback(number)
    commands.robot_command_feedback_async().result()


def test_feedback_tells_how_the_commands_lease_was_used(commands: Any, stub: Any) -> None:
    """The proto names the field, and clients in other languages read it without asking whether it is there."""
    stub.robot.set(motor_power=MotorPower.ON)
    number = commands.robot_command(RobotCommandBuilder.synchro_stand_command())
    use = commands.robot_command_feedback(number).lease_use_result
    assert (use.status, use.attempted_lease.resource) == (use.STATUS_OK, "body")
    assert list(use.attempted_lease.sequence) == list(use.latest_known_lease.sequence)


def test_feedback_follows_the_robot(commands: Any, stub: Any) -> None:
    def mobility(number: int) -> Any:
        return commands.robot_command_feedback(number).feedback.synchronized_feedback.mobility_command_feedback

    with pytest.raises(InvalidRequestError, match="no robot command was given"):
        commands.robot_command_feedback()
    stand = commands.robot_command(RobotCommandBuilder.synchro_stand_command())
    assert mobility(stand).stand_feedback.status == Stand.STATUS_IN_PROGRESS
    stub.robot.set(mode=Mode.STANDING)
    assert mobility(stand).stand_feedback.status == Stand.STATUS_IS_STANDING
    assert mobility(stand).status == basic_command_pb2.RobotCommandFeedbackStatus.STATUS_PROCESSING
    sit = commands.robot_command(RobotCommandBuilder.synchro_sit_command())
    assert mobility(stand).status == basic_command_pb2.RobotCommandFeedbackStatus.STATUS_COMMAND_OVERRIDDEN
    stub.robot.set(motor_power=MotorPower.OFF)
    assert mobility(sit).status == basic_command_pb2.RobotCommandFeedbackStatus.STATUS_ROBOT_FROZEN
    with pytest.raises(InvalidRequestError, match="no robot command 99"):
        commands.robot_command_feedback(99)


@pytest.mark.parametrize(
    "command",
    [
        RobotCommandBuilder.battery_change_pose_command(),
        RobotCommandBuilder.payload_estimation_command(),
        RobotCommandBuilder.arm_stow_command(),
        RobotCommandBuilder.claw_gripper_open_command(),
        robot_command_pb2.RobotCommand(
            synchronized_command=synchronized_command_pb2.SynchronizedCommand.Request(
                arm_command=arm_command_pb2.ArmCommand.Request()
            )
        ),
    ],
)
def test_what_the_fake_cannot_do_is_unsupported(commands: Any, stub: Any, command: Any) -> None:
    before = list(stub.robot.calls)
    with pytest.raises(UnsupportedError) as refused:
        commands.robot_command(command, end_time_secs=2e9)
    assert "does not know" in refused.value.response.message or "no arm" in refused.value.response.message
    assert stub.robot.calls == before


def test_an_empty_command_is_invalid(commands: Any) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        commands.robot_command(robot_command_pb2.RobotCommand())
    assert "empty" in refused.value.response.message


def test_no_motion_without_power_licence_or_with_faults(commands: Any, stub: Any) -> None:
    stand, joint = RobotCommandBuilder.synchro_stand_command(), RobotCommandBuilder.joint_command()
    stub.server.world.license.state = "expired"
    with pytest.raises(UnsupportedError) as unlicensed:
        commands.robot_command(joint)
    assert "licence" in unlicensed.value.response.message
    stub.robot.add_behavior_fault("fall")
    with pytest.raises(BehaviorFaultError):
        commands.robot_command(stand)
    fault = stub.sdk_robot().ensure_client("robot-state").get_robot_state().behavior_fault_state.faults[0]
    assert fault.cause == fault.CAUSE_FALL
    with pytest.raises(NotClearedError):
        commands.clear_behavior_fault(42)
    assert commands.clear_behavior_fault(fault.behavior_fault_id)
    commands.robot_command(stand)
    stub.robot.set(motor_power=MotorPower.OFF)
    with pytest.raises(NotPoweredOnError):
        commands.robot_command(stand)
    commands.robot_command(RobotCommandBuilder.safe_power_off_command())


# --------------------------------------------------------------------------------------------------------- streams


def joint_request(key: int) -> robot_command_pb2.JointControlStreamRequest:
    request = robot_command_pb2.JointControlStreamRequest()
    request.joint_command.user_command_key = key
    request.header.client_name = "test"
    return request


def test_the_state_stream_passes_bytes_on_and_ends_on_cancel(robot: Any, stub: Any) -> None:
    from bosdyn.api import robot_state_pb2

    stream = robot.ensure_client("robot-state-streaming").get_robot_state_stream()
    sent = [robot_state_pb2.RobotStateStreamResponse(contact_states=[1, 2, 1, index % 3]) for index in range(20)]
    while not stub.robot.subscriptions:
        threading.Event().wait(0.01)
    for message in sent:
        stub.robot.subscriptions[0].messages.put(message.SerializeToString())
    assert [next(stream) for _ in sent] == sent
    stream.cancel()
    with pytest.raises(grpc.RpcError):
        next(stream)
    while not stub.robot.subscriptions[0].is_closed:
        threading.Event().wait(0.01)


def test_a_state_stream_that_the_robot_ends_is_unavailable(robot: Any, stub: Any) -> None:
    stream = robot.ensure_client("robot-state-streaming").get_robot_state_stream()
    while not stub.robot.subscriptions:
        threading.Event().wait(0.01)
    stub.server.faults.inject("state_stream_closed", {}, None)
    with pytest.raises(grpc.RpcError) as ended:
        next(stream)
    assert ended.value.code() is grpc.StatusCode.UNAVAILABLE


def test_joint_commands_arrive_in_order_and_the_verdict_comes_at_the_end(robot: Any, stub: Any) -> None:
    client = robot.ensure_client("robot-command-streaming")
    answer = client.send_joint_control_commands(joint_request(key) for key in range(1, 200))
    assert answer.status == Status.STATUS_OK
    assert answer.header.request_header.client_name == "test"
    keys = [request.joint_command.user_command_key for request in stub.robot.streams[0].requests]
    assert keys == list(range(1, 200))
    assert stub.robot.streams[0].is_closed


class SlowRequests:
    """Sends one request, then is silent until it is told to end."""

    def __init__(self) -> None:
        self.done = threading.Event()

    def __iter__(self) -> Iterator[robot_command_pb2.JointControlStreamRequest]:
        yield joint_request(1)
        self.done.wait(30)


def test_the_robot_can_end_a_stream_whose_client_is_silent(robot: Any, stub: Any) -> None:
    client = robot.ensure_client("robot-command-streaming")
    requests = SlowRequests()
    answers: list[Any] = []
    caller = threading.Thread(target=lambda: answers.append(client.send_joint_control_commands(iter(requests))))
    caller.start()
    while not stub.robot.streams:
        threading.Event().wait(0.01)
    stub.robot.streams[0].arrived.acquire(timeout=10)
    stub.robot.streams[0].fail(Status.STATUS_EXPIRED, "too late by 3 ms")
    caller.join(timeout=10)
    requests.done.set()
    assert answers[0].status == Status.STATUS_EXPIRED
    assert answers[0].message == "too late by 3 ms"


@pytest.mark.parametrize(("policy", "refused"), [("refuse", 1), ("evict", 0)])
def test_a_second_stream(serve_stub: Callable[..., Any], policy: str, refused: int) -> None:
    stub = serve_stub(second_command_stream=policy)
    robots = [stub.sdk_robot(RobotCommandStreamingClient) for _ in range(2)]
    requests = [SlowRequests(), SlowRequests()]
    answers: dict[int, Any] = {}

    def call(index: int) -> None:
        client = robots[index].ensure_client("robot-command-streaming")
        answers[index] = client.send_joint_control_commands(iter(requests[index]))

    callers = [threading.Thread(target=call, args=(index,)) for index in range(2)]
    callers[0].start()
    while not stub.robot.streams:
        threading.Event().wait(0.01)
    callers[1].start()
    callers[refused].join(timeout=10)
    assert "another joint-control stream" in answers[refused].message
    for request in requests:
        request.done.set()
    callers[1 - refused].join(timeout=10)
    assert answers[1 - refused].status == Status.STATUS_OK


def test_a_flood_of_commands_is_stopped(serve_stub: Callable[..., Any]) -> None:
    stub = serve_stub(max_command_rate_hz=100.0)
    client = stub.sdk_robot(RobotCommandStreamingClient).ensure_client("robot-command-streaming")
    answer = client.send_joint_control_commands(joint_request(key) for key in range(1, 5000))
    assert answer.status == Status.STATUS_INVALID_REQUEST
    assert "more than 100 joint commands in 1 s" in answer.message


def test_estop_level_is_part_of_the_polled_state(robot: Any, stub: Any) -> None:
    stub.robot.set(estop_level=EstopLevel.CUT)
    stub.server.world.estop.press_elsewhere(is_pressed=True)
    states = robot.ensure_client("robot-state").get_robot_state().estop_states
    assert {state.name: state.state for state in states}["software_estop"] == states[0].STATE_ESTOPPED


def test_errors_of_the_sdk_carry_the_robots_words(robot: Any) -> None:
    with pytest.raises(ResponseError, match="no power command 5"):
        robot.ensure_client("power").power_command_feedback(5)
