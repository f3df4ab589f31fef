"""Walking commands as they come from the SDK: what becomes a plan, what is refused and how, and what feedback says."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from bosdyn.api import basic_command_pb2, geometry_pb2, robot_command_pb2
from bosdyn.api.spot import robot_command_pb2 as spot_command_pb2
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.network.requests import PathPlan, VelocityPlan, WalkProgress
from fake_robot.network.status import Mode, MotorPower, StanceProgress

Response = robot_command_pb2.RobotCommandResponse
Trajectory = basic_command_pb2.SE2TrajectoryCommand.Feedback
Processing = basic_command_pb2.RobotCommandFeedbackStatus


class Client:
    """A synchronised SDK client with the lease that reads statuses instead of exceptions."""

    def __init__(self, stub: Any) -> None:
        self.stub = stub
        self.robot = stub.sdk_robot()
        self.lease = self.robot.ensure_client("lease").acquire()
        stub.robot.set(motor_power=MotorPower.ON, mode=Mode.STANDING)
        self.robot.time_sync.wait_for_sync(timeout_sec=10)
        self.client = self.robot.ensure_client("robot-command")

    def send(self, command: Any, *, end_s: float | None = 5.0, clock: str | None = None) -> Any:
        """The response to a command that ends ``end_s`` from now."""
        request = robot_command_pb2.RobotCommandRequest(lease=self.lease.lease_proto, command=command)
        endpoint = self.robot.time_sync.endpoint
        request.clock_identifier = endpoint.clock_identifier if clock is None else clock
        if end_s is not None:
            mobility = request.command.synchronized_command.mobility_command
            timed = getattr(mobility, mobility.WhichOneof("command"))
            timed.end_time.CopyFrom(endpoint.robot_timestamp_from_local_secs(time.time() + end_s))
        return self.client._stub.RobotCommand(request)

    def feedback(self, response: Any) -> Any:
        answer = self.client.robot_command_feedback(response.robot_command_id)
        return answer.feedback.synchronized_feedback.mobility_command_feedback


@pytest.fixture
def client(serve_stub: Callable[..., Any]) -> Iterator[Client]:
    client = Client(serve_stub())
    yield client
    client.robot.stop_time_sync()


def velocity(*, frame: str = "body", v: tuple[float, float, float] = (0.5, 0.1, 0.2), **keywords: Any) -> Any:
    return RobotCommandBuilder.synchro_velocity_command(*v, frame_name=frame, **keywords)


def trajectory(frame: str = "odom", goal: tuple[float, float, float] = (1.0, 2.0, 0.5), **keywords: Any) -> Any:
    return RobotCommandBuilder.synchro_se2_trajectory_command(SE2Pose(*goal).to_proto(), frame, **keywords)


def test_a_velocity_in_the_body_frame_becomes_a_plan(client: Client) -> None:
    assert client.send(velocity()).status == Response.STATUS_OK
    (plan,) = client.stub.robot.plans
    assert isinstance(plan, VelocityPlan)
    assert plan.velocity == (0.5, 0.1, 0.2)
    assert plan.is_in_body
    assert plan.limits.high == (1.6, 1.6, 2.0)


def test_a_velocity_in_a_frame_of_the_world_is_turned_into_odom(client: Client) -> None:
    half = math.sqrt(0.5)
    # Vision's axes are turned by +90 degrees against odom's when a body with yaw 0 in vision has yaw 90 in odom.
    client.stub.robot.set(
        odom_from_body_wxyz=np.array([half, 0.0, 0.0, half]), vision_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0])
    )
    assert client.send(velocity(frame="vision", v=(0.5, 0.0, 0.2))).status == Response.STATUS_OK
    (plan,) = client.stub.robot.plans
    assert not plan.is_in_body
    assert plan.velocity == pytest.approx((0.0, 0.5, 0.2), abs=1e-9)


@pytest.mark.parametrize(("frame", "goal"), [("odom", (1.0, 2.0, 0.5)), ("body", (2.0, 4.0, 0.5)), ("vision", None)])
def test_a_goal_in_any_frame_becomes_one_in_odom(client: Client, frame: str, goal: tuple[float, ...] | None) -> None:
    # The stub's body is at (1, 2) in odom and (3, 4) in vision, with yaw 0 in both.
    assert client.send(trajectory(frame)).status == Response.STATUS_OK
    (plan,) = client.stub.robot.plans
    assert isinstance(plan, PathPlan)
    point = plan.points[-1]
    assert (point.x_m, point.y_m, point.yaw_rad) == pytest.approx(goal or (-1.0, 0.0, 0.5))


def test_limits_and_body_height_come_with_the_command(client: Client) -> None:
    limit = geometry_pb2.SE2VelocityLimit(
        max_vel=geometry_pb2.SE2Velocity(linear=geometry_pb2.Vec2(x=0.4, y=9.0), angular=0.0),
        min_vel=geometry_pb2.SE2Velocity(linear=geometry_pb2.Vec2(x=-0.3, y=-9.0), angular=-0.5),
    )
    params = RobotCommandBuilder.mobility_params(body_height=-0.05)
    params.vel_limit.CopyFrom(limit)
    assert client.send(trajectory(params=params)).status == Response.STATUS_OK
    (plan,) = client.stub.robot.plans
    assert plan.limits.high == (0.4, 1.6, 2.0)
    assert plan.limits.low == (-0.3, -1.6, -0.5)
    assert plan.limits.pose.height_m == pytest.approx(-0.05)


def test_points_have_times_counted_from_the_reference(client: Client) -> None:
    command = trajectory()
    request = command.synchronized_command.mobility_command.se2_trajectory_request
    request.trajectory.points[0].time_since_reference.FromNanoseconds(2_000_000_000)
    later = request.trajectory.points.add()
    later.time_since_reference.FromNanoseconds(4_000_000_000)
    now_ns = client.stub.robot.clock.now_ns()
    request.trajectory.reference_time.FromNanoseconds(now_ns - 1_000_000_000)
    assert client.send(command).status == Response.STATUS_OK
    assert [p.after_s for p in client.stub.robot.plans[0].points] == pytest.approx([1.0, 3.0])


@pytest.mark.parametrize(
    ("command", "end_s", "status"),
    [
        (velocity(), None, Response.STATUS_EXPIRED),
        (velocity(), -1.0, Response.STATUS_EXPIRED),
        (velocity(), 3600.0, Response.STATUS_TOO_DISTANT),
        (velocity(frame="moon"), 5.0, Response.STATUS_UNKNOWN_FRAME),
        (velocity(v=(math.nan, 0.0, 0.0)), 5.0, Response.STATUS_INVALID_REQUEST),
        (trajectory("flat_body"), 5.0, Response.STATUS_UNKNOWN_FRAME),
        (trajectory(goal=(math.inf, 0.0, 0.0)), 5.0, Response.STATUS_INVALID_REQUEST),
    ],
)
def test_what_is_refused_and_how(client: Client, command: Any, end_s: float | None, status: int) -> None:
    response = client.send(command, end_s=end_s)
    assert response.status == status
    assert response.message
    assert "walk" not in client.stub.robot.calls


@pytest.mark.parametrize("clock", ["", "somebody-else"])
def test_a_client_without_time_sync_moves_nothing(client: Client, clock: str) -> None:
    response = client.send(velocity(), clock=clock)
    assert response.status == Response.STATUS_NO_TIMESYNC
    assert "wait for time sync" in response.message
    assert "walk" not in client.stub.robot.calls


@pytest.mark.parametrize(
    ("check", "stand", "walk"),
    [
        ("every_command", Response.STATUS_NO_TIMESYNC, Response.STATUS_NO_TIMESYNC),
        ("timed_commands", Response.STATUS_OK, Response.STATUS_NO_TIMESYNC),
        ("none", Response.STATUS_OK, Response.STATUS_OK),
    ],
)
def test_which_commands_need_time_sync_is_a_switch(
    serve_stub: Callable[..., Any], check: str, stand: int, walk: int
) -> None:
    client = Client(serve_stub(clock_identifier_check=check))
    assert client.send(RobotCommandBuilder.synchro_stand_command(), end_s=None, clock="").status == stand
    assert client.send(velocity(), clock="").status == walk
    client.robot.stop_time_sync()


def test_how_a_missing_end_time_is_refused_is_a_switch(serve_stub: Callable[..., Any]) -> None:
    client = Client(serve_stub(missing_end_time_refusal="invalid_request"))
    assert client.send(velocity(), end_s=None).status == Response.STATUS_INVALID_REQUEST
    client.robot.stop_time_sync()


def test_feedback_follows_a_trajectory_to_its_goal(client: Client) -> None:
    sent = client.send(trajectory())
    steps = [
        (Mode.WALKING, WalkProgress.WALKING, Trajectory.STATUS_GOING_TO_GOAL, Trajectory.BODY_STATUS_MOVING),
        (Mode.WALKING, WalkProgress.ARRIVING, Trajectory.STATUS_NEAR_GOAL, Trajectory.BODY_STATUS_MOVING),
        (Mode.WALKING, WalkProgress.ARRIVED, Trajectory.STATUS_NEAR_GOAL, Trajectory.BODY_STATUS_MOVING),
        (Mode.STANDING, WalkProgress.ARRIVED, Trajectory.STATUS_AT_GOAL, Trajectory.BODY_STATUS_SETTLED),
    ]
    for mode, progress, status, body in steps:
        client.stub.robot.set(mode=mode, walk_progress=progress)
        told = client.feedback(sent)
        assert told.status == Processing.STATUS_PROCESSING
        assert (told.se2_trajectory_feedback.status, told.se2_trajectory_feedback.body_movement_status) == (
            status,
            body,
        )
    assert told.se2_trajectory_feedback.final_goal_status == Trajectory.FINAL_GOAL_STATUS_ACHIEVABLE
    client.stub.robot.clock.pass_s(10.0)
    assert client.feedback(sent).status == Processing.STATUS_PROCESSING


def test_a_walk_whose_time_is_over_has_timed_out(client: Client) -> None:
    sent = client.send(trajectory())
    client.stub.robot.set(mode=Mode.WALKING, walk_progress=WalkProgress.WALKING)
    client.stub.robot.clock.pass_s(10.0)
    assert client.feedback(sent).status == Processing.STATUS_COMMAND_TIMED_OUT


def stance(x_m: float = 0.3, accuracy: float = 0.05, frame: str = "vision") -> Any:
    feet = [geometry_pb2.Vec2(x=x, y=y) for x in (x_m, -x_m) for y in (0.2, -0.2)]
    return RobotCommandBuilder.stance_command(frame, *feet, accuracy=accuracy)


def test_a_stance_places_the_feet_and_says_how_it_goes(client: Client) -> None:
    sent = client.send(stance())
    assert sent.status == Response.STATUS_OK
    assert client.stub.robot.calls[-1] == "place_feet"
    Stance = basic_command_pb2.StanceCommand.Feedback  # noqa: N806
    for progress, status in (
        (StanceProgress.MOVING, Stance.STATUS_GOING_TO_STANCE),
        (StanceProgress.REACHED, Stance.STATUS_STANCED),
        (StanceProgress.TOO_FAR, Stance.STATUS_TOO_FAR_AWAY),
    ):
        client.stub.robot.set(stance_progress=progress)
        assert client.feedback(sent).stance_feedback.status == status


def test_a_stance_needs_four_feet_and_an_accuracy_within_bounds(client: Client) -> None:
    assert client.send(stance(accuracy=0.5)).status == Response.STATUS_INVALID_REQUEST
    assert client.send(stance(frame="gpe")).status == Response.STATUS_UNKNOWN_FRAME
    three = stance()
    del three.synchronized_command.mobility_command.stance_request.stance.foot_positions["hl"]
    told = client.send(three)
    assert told.status == Response.STATUS_INVALID_REQUEST
    assert "fl, fr, hl, hr" in told.message


def test_params_of_another_type_are_invalid(client: Client) -> None:
    command = velocity()
    command.synchronized_command.mobility_command.params.Pack(spot_command_pb2.BodyControlParams())
    assert client.send(command).status == Response.STATUS_INVALID_REQUEST
