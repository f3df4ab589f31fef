"""Checks of robot commands: what is refused before anything moves, and what moves."""

from __future__ import annotations

import math
from typing import Any

from bosdyn.api import (
    geometry_pb2,
    lease_pb2,
    robot_command_pb2,
    robot_command_service_pb2_grpc,
    synchronized_command_pb2,
)
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.check import Basis, Needs, check
from fake_robot.conformance.powered import powered
from fake_robot.conformance.server import RPC_TIMEOUT_S, Server, SkippedError, enum_name, header, is_off, status_of

_PROTO = "robot_command.proto"
_BASIC = "basic_command.proto"
FAR_S = 1e7
"""An end time that far ahead cannot be meant."""


def send(
    server: Server, lease: lease_pb2.Lease, command: Any, *, clock: str | None = None, end_s: float | None = 5.0
) -> robot_command_pb2.RobotCommandResponse:
    """Send a command; a timed one ends ``end_s`` from now, or bears no end time."""
    request = robot_command_pb2.RobotCommandRequest(header=header(), lease=lease, command=command)
    request.clock_identifier = server.clock_identifier if clock is None else clock
    mobility = request.command.synchronized_command.mobility_command
    field = mobility.WhichOneof("command")
    if end_s is not None and field in {"se2_velocity_request", "se2_trajectory_request", "stance_request"}:
        getattr(mobility, field).end_time.CopyFrom(server.robot_stamp(end_s))
    stub = server.stub(robot_command_service_pb2_grpc.RobotCommandServiceStub, "robot-command")
    return stub.RobotCommand(request, timeout=RPC_TIMEOUT_S)


def _refused(server: Server, command: Any, **keywords: Any) -> str:
    """The answer to a command while the motors are off, so that nothing can move."""
    if not is_off(server.state()):
        raise SkippedError("the motors are on")
    with server.lease() as lease:
        return status_of(send(server, lease, command, **keywords))


def _at_rest() -> Any:
    return RobotCommandBuilder.synchro_velocity_command(0.0, 0.0, 0.0)


@check("RobotCommand.RobotCommand: lease", "no lease", "STATUS_INVALID_LEASE", source=_PROTO)
def command_without_lease(server: Server) -> str:
    """Stand, without a lease."""
    answer = send(server, lease_pb2.Lease(), RobotCommandBuilder.synchro_stand_command())
    return status_of(answer.lease_use_result)


@check(
    "RobotCommand.RobotCommand: command", "an empty command", "STATUS_INVALID_REQUEST", source=_PROTO, needs=Needs.LEASE
)
def empty_command(server: Server) -> str:
    """A command that asks for nothing."""
    return _refused(server, robot_command_pb2.RobotCommand())


@check(
    "RobotCommand.RobotCommand: command",
    "a synchronized command that is empty",
    "STATUS_INVALID_REQUEST",
    basis=Basis.GUESS,
    source=_PROTO,
    needs=Needs.LEASE,
)
def empty_synchronized_command(server: Server) -> str:
    """A synchronised command that asks for nothing."""
    inner = synchronized_command_pb2.SynchronizedCommand.Request()
    return _refused(server, robot_command_pb2.RobotCommand(synchronized_command=inner))


@check(
    "RobotCommand.RobotCommand: clock_identifier",
    "a timed command, no identifier",
    "STATUS_NO_TIMESYNC",
    source=_PROTO,
    needs=Needs.LEASE,
    switch="services.clock_identifier_check",
)
def timed_without_clock(server: Server) -> str:
    """A velocity of zero from a client without time sync."""
    return _refused(server, _at_rest(), clock="")


@check(
    "RobotCommand.RobotCommand: clock_identifier",
    "a timed command, an identifier never given",
    "STATUS_NO_TIMESYNC",
    source=_PROTO,
    needs=Needs.LEASE,
    switch="services.clock_identifier_check",
)
def timed_with_unknown_clock(server: Server) -> str:
    """A velocity of zero from a client of before a reboot."""
    return _refused(server, _at_rest(), clock="no-such-client")


@check(
    "RobotCommand.RobotCommand: clock_identifier",
    "a stand, no identifier",
    ("STATUS_NO_TIMESYNC", "STATUS_NOT_POWERED_ON"),
    basis=Basis.GUESS,
    source=_PROTO,
    needs=Needs.LEASE,
    switch="services.clock_identifier_check",
)
def stand_without_clock(server: Server) -> str:
    """Whether a command without an end time needs time sync, too."""
    return _refused(server, RobotCommandBuilder.synchro_stand_command(), clock="")


@check("RobotCommand.RobotCommand", "a stand, motors off", "STATUS_NOT_POWERED_ON", source=_PROTO, needs=Needs.LEASE)
def stand_without_power(server: Server) -> str:
    """Stand before power on."""
    return _refused(server, RobotCommandBuilder.synchro_stand_command())


@check(
    "RobotCommand.RobotCommand: end_time",
    "an end time that has passed",
    "STATUS_EXPIRED",
    source=_PROTO,
    needs=Needs.LEASE,
)
def expired_command(server: Server) -> str:
    """A velocity of zero that ended a second ago."""
    return _refused(server, _at_rest(), end_s=-1.0)


@check(
    "RobotCommand.RobotCommand: end_time",
    "no end time",
    ("STATUS_EXPIRED", "STATUS_INVALID_REQUEST"),
    basis=Basis.GUESS,
    source=f"{_BASIC}: a required field",
    needs=Needs.LEASE,
    switch="services.missing_end_time_refusal",
)
def command_without_end(server: Server) -> str:
    """A velocity of zero for ever."""
    return _refused(server, _at_rest(), end_s=None)


@check(
    "RobotCommand.RobotCommand: end_time",
    "an end time months ahead",
    "STATUS_TOO_DISTANT",
    source=_PROTO,
    needs=Needs.LEASE,
    switch="services.max_command_duration_s",
)
def distant_command(server: Server) -> str:
    """A velocity of zero for months."""
    return _refused(server, _at_rest(), end_s=FAR_S)


@check(
    "RobotCommand.RobotCommand: se2_frame_name",
    "a velocity in a frame that is none",
    "STATUS_UNKNOWN_FRAME",
    source=_BASIC,
    needs=Needs.LEASE,
)
def unknown_frame(server: Server) -> str:
    """A velocity of zero in a frame that is none."""
    return _refused(server, RobotCommandBuilder.synchro_velocity_command(0.0, 0.0, 0.0, frame_name="no-such-frame"))


@check(
    "RobotCommand.RobotCommand: se2_frame_name",
    "a trajectory in a frame that is none",
    "STATUS_UNKNOWN_FRAME",
    source=_BASIC,
    needs=Needs.LEASE,
)
def unknown_trajectory_frame(server: Server) -> str:
    """A trajectory to here in a frame that is none."""
    here = SE2Pose(0.0, 0.0, 0.0).to_proto()
    return _refused(server, RobotCommandBuilder.synchro_se2_trajectory_command(here, "no-such-frame"))


@check(
    "RobotCommand.RobotCommand: velocity",
    "a velocity that is no number",
    ("STATUS_INVALID_REQUEST", "STATUS_NOT_POWERED_ON"),
    basis=Basis.GUESS,
    source=_PROTO,
    needs=Needs.LEASE,
)
def velocity_not_a_number(server: Server) -> str:
    """A velocity of NaN."""
    return _refused(server, RobotCommandBuilder.synchro_velocity_command(math.nan, 0.0, 0.0))


@check(
    "RobotCommand.RobotCommand: trajectory",
    "no point",
    ("STATUS_INVALID_REQUEST", "STATUS_NOT_POWERED_ON"),
    basis=Basis.GUESS,
    source=_PROTO,
    needs=Needs.LEASE,
)
def trajectory_without_points(server: Server) -> str:
    """A trajectory that leads nowhere."""
    command = RobotCommandBuilder.synchro_se2_trajectory_command(SE2Pose(0, 0, 0).to_proto(), "odom")
    del command.synchronized_command.mobility_command.se2_trajectory_request.trajectory.points[:]
    return _refused(server, command)


@check(
    "RobotCommand.RobotCommand: foot_positions",
    "a stance of three feet",
    ("STATUS_INVALID_REQUEST", "STATUS_NOT_POWERED_ON"),
    basis=Basis.GUESS,
    source=f"{_BASIC}: required positions",
    needs=Needs.LEASE,
)
def stance_of_three_feet(server: Server) -> str:
    """A stance without the hind right foot."""
    feet = [geometry_pb2.Vec2(x=x, y=y) for x in (0.3, -0.3) for y in (0.2, -0.2)]
    command = RobotCommandBuilder.stance_command("odom", *feet)
    del command.synchronized_command.mobility_command.stance_request.stance.foot_positions["hr"]
    return _refused(server, command)


@check(
    "RobotCommand.RobotCommand: arm_command",
    "an arm command to a robot without an arm",
    "STATUS_UNSUPPORTED",
    source=_PROTO,
    needs=Needs.LEASE,
)
def arm_command(server: Server) -> str:
    """Stow an arm that is not there."""
    if server.state().HasField("manipulator_state"):
        raise SkippedError("the robot has an arm")
    return _refused(server, RobotCommandBuilder.arm_stow_command())


@check(
    "RobotCommand.ClearBehaviorFault: behavior_fault_id",
    "a number that is none",
    "STATUS_NOT_CLEARED",
    source=_PROTO,
    needs=Needs.LEASE,
)
def clear_no_fault(server: Server) -> str:
    """Clear a fault that is none."""
    with server.lease() as lease:
        return status_of(server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=0xFFFFFFF0))


@check(
    "RobotCommand.RobotCommandFeedback: robot_command_id",
    "a number that is none",
    "CODE_INVALID_REQUEST",
    basis=Basis.GUESS,
    source="header.proto",
)
def feedback_of_nothing(server: Server) -> str:
    """Ask after a command that was never given."""
    answer = server.ask("robot-command", "RobotCommandFeedback", robot_command_id=0xFFFFFFF0)
    return enum_name(answer.header.error, "code")


@check("RobotCommand.RobotCommand", "a stand, a short way ahead, a sit", "arrived", source=_BASIC, needs=Needs.MOTION)
def trajectory_arrives(server: Server) -> str:
    """Walk half a metre ahead in the body frame; the status becomes STATUS_STOPPED."""
    with powered(server) as lease:
        goal = SE2Pose(0.5, 0.0, 0.0).to_proto()
        sent = send(server, lease, RobotCommandBuilder.synchro_se2_trajectory_command(goal, "body"), end_s=15.0)
        if status_of(sent) != "STATUS_OK":
            return status_of(sent)
        client = server.robot.ensure_client("robot-command")

        def has_stopped() -> bool:
            told = client.robot_command_feedback(sent.robot_command_id).feedback
            walk = told.synchronized_feedback.mobility_command_feedback.se2_trajectory_feedback
            return bool(walk.status == walk.STATUS_STOPPED)

        server.wait_for(has_stopped, "arrive")
    return "arrived"


@check(
    "RobotCommand.RobotCommand",
    "a velocity for a second, in the body frame",
    "taken, then timed out",
    basis=Basis.MEASURED,
    source="the SDK's wasd example; basic_command.proto names flat_body alone",
    needs=Needs.MOTION,
)
def velocity_times_out(server: Server) -> str:
    """Step on the spot for a second; afterwards the command has timed out."""
    with powered(server) as lease:
        sent = send(server, lease, RobotCommandBuilder.synchro_velocity_command(0.0, 0.0, 0.2), end_s=1.0)
        if status_of(sent) != "STATUS_OK":
            return status_of(sent)
        client = server.robot.ensure_client("robot-command")

        def is_over() -> bool:
            told = client.robot_command_feedback(sent.robot_command_id).feedback
            feedback = told.synchronized_feedback.mobility_command_feedback
            return bool(enum_name(feedback, "status") == "STATUS_COMMAND_TIMED_OUT")

        server.wait_for(is_over, "stop at the end of the command")
    return "taken, then timed out"
