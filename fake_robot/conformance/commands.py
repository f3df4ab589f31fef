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

from fake_robot.conformance.check import Basis, Check, Needs, check
from fake_robot.conformance.server import (
    RPC_TIMEOUT_S,
    Server,
    SkippedError,
    enum_name,
    header,
    is_off,
    powered,
    status_of,
)

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


def _refused(server: Server, command: Any, *expects: str, **keywords: Any) -> str:
    """The answer to a command while the motors are off, so that nothing can move.

    Raises:
        SkippedError: The motors are on, or the server refuses a command for their sake before it looks at end times and
            frames; the protos name no order.
    """
    if not is_off(server.state()):
        raise SkippedError("the motors are on")
    with server.lease() as lease:
        seen = status_of(send(server, lease, command, **keywords))
        if seen == _UNPOWERED and seen not in expects:
            all_wrong = send(server, lease, _NOWHERE, clock=keywords.get("clock"), end_s=-1.0)
            if status_of(all_wrong) == _UNPOWERED:
                raise SkippedError("the server looks at the motors' power before what is wrong here")
        return seen


@check("RobotCommand.RobotCommand: lease", "no lease", "STATUS_INVALID_LEASE", source=_PROTO)
def command_without_lease(server: Server) -> str:
    """Stand, without a lease."""
    answer = send(server, lease_pb2.Lease(), RobotCommandBuilder.synchro_stand_command())
    return status_of(answer.lease_use_result)


_AT_REST = RobotCommandBuilder.synchro_velocity_command(0.0, 0.0, 0.0)
_STAND = RobotCommandBuilder.synchro_stand_command()
_HERE = SE2Pose(0.0, 0.0, 0.0).to_proto()
_NOWHERE = RobotCommandBuilder.synchro_velocity_command(0.0, 0.0, 0.0, frame_name="no-such-frame")
_TO_NOWHERE = RobotCommandBuilder.synchro_se2_trajectory_command(_HERE, "odom")
del _TO_NOWHERE.synchronized_command.mobility_command.se2_trajectory_request.trajectory.points[:]
_ON_THREE_FEET = RobotCommandBuilder.stance_command(
    "odom", *(geometry_pb2.Vec2(x=x, y=y) for x in (0.3, -0.3) for y in (0.2, -0.2))
)
del _ON_THREE_FEET.synchronized_command.mobility_command.stance_request.stance.foot_positions["hr"]

_CLOCK, _END, _FRAME = "clock_identifier", "end_time", "se2_frame_name"
_INVALID, _NO_TIME_SYNC = "STATUS_INVALID_REQUEST", "STATUS_NO_TIMESYNC"
_EXPIRED, _UNPOWERED = "STATUS_EXPIRED", "STATUS_NOT_POWERED_ON"
_CLOCK_SWITCH = "services.clock_identifier_check"


def _refusal(
    name: str,
    field: str,
    sends: str,
    command: Any,
    *expects: str,
    basis: Basis = Basis.DOCUMENTED,
    source: str = _PROTO,
    switch: str = "",
    **keywords: Any,
) -> Check:
    """A command that is refused while the motors are off; ``keywords`` as of :func:`send`."""
    rpc = "RobotCommand.RobotCommand" + (f": {field}" if field else "")

    def probe(server: Server) -> str:
        return _refused(server, command, *expects, **keywords)

    return Check(name, rpc, sends, expects, basis, source, Needs.LEASE, switch, probe)


def _guess(name: str, field: str, sends: str, command: Any, *expects: str, **keywords: Any) -> Check:
    return _refusal(name, field, sends, command, *expects, basis=Basis.GUESS, **keywords)


REFUSALS = (
    _refusal("empty_command", "command", "an empty command", robot_command_pb2.RobotCommand(), _INVALID),
    _guess(
        "empty_synchronized_command",
        "command",
        "a synchronized command that is empty",
        robot_command_pb2.RobotCommand(synchronized_command=synchronized_command_pb2.SynchronizedCommand.Request()),
        _INVALID,
    ),
    _refusal(
        "timed_without_clock",
        _CLOCK,
        "a timed command, no identifier",
        _AT_REST,
        _NO_TIME_SYNC,
        clock="",
        switch=_CLOCK_SWITCH,
    ),
    _refusal(
        "timed_with_unknown_clock",
        _CLOCK,
        "a timed command, an identifier never given",
        _AT_REST,
        _NO_TIME_SYNC,
        clock="no-such-client",
        switch=_CLOCK_SWITCH,
    ),
    _guess(
        "stand_without_clock",
        _CLOCK,
        "a stand, no identifier",
        _STAND,
        _NO_TIME_SYNC,
        _UNPOWERED,
        clock="",
        switch=_CLOCK_SWITCH,
    ),
    _refusal("stand_without_power", "", "a stand, motors off", _STAND, _UNPOWERED),
    _refusal("expired_command", _END, "an end time that has passed", _AT_REST, _EXPIRED, end_s=-1.0),
    _refusal(
        "distant_command",
        _END,
        "an end time months ahead",
        _AT_REST,
        "STATUS_TOO_DISTANT",
        end_s=FAR_S,
        switch="services.max_command_duration_s",
    ),
    _refusal(
        "unknown_frame",
        _FRAME,
        "a velocity in an unknown frame",
        _NOWHERE,
        "STATUS_UNKNOWN_FRAME",
        source=_BASIC,
    ),
    _refusal(
        "unknown_trajectory_frame",
        _FRAME,
        "a trajectory in an unknown frame",
        RobotCommandBuilder.synchro_se2_trajectory_command(_HERE, "no-such-frame"),
        "STATUS_UNKNOWN_FRAME",
        source=_BASIC,
    ),
    _guess(
        "velocity_not_a_number",
        "velocity",
        "a velocity that is NaN",
        RobotCommandBuilder.synchro_velocity_command(math.nan, 0.0, 0.0),
        _INVALID,
        _UNPOWERED,
    ),
    _guess("trajectory_without_points", "trajectory", "no point", _TO_NOWHERE, _INVALID, _UNPOWERED),
    _guess(
        "stance_of_three_feet",
        "foot_positions",
        "a stance of three feet",
        _ON_THREE_FEET,
        _INVALID,
        _UNPOWERED,
        source=f"{_BASIC}: required positions",
    ),
)


@check(
    f"RobotCommand.RobotCommand: {_END}",
    "no end time",
    "refused",
    source=f"{_BASIC}: a required field",
    needs=Needs.LEASE,
    switch="services.missing_end_time_refusal",
)
def command_without_end(server: Server) -> str:
    """A velocity for ever; the proto does not name the status."""
    seen = _refused(server, _AT_REST, end_s=None)
    return "refused" if seen in {_EXPIRED, _INVALID} else seen


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
    "an unknown number",
    "STATUS_NOT_CLEARED",
    source=_PROTO,
    needs=Needs.LEASE,
)
def clear_no_fault(server: Server) -> str:
    """Clear an unknown fault."""
    with server.lease() as lease:
        return status_of(server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=0xFFFFFFF0))


@check(
    "RobotCommand.RobotCommandFeedback: robot_command_id",
    "an unknown number",
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
