"""Checks of robot commands: what is refused before anything moves, and how the one motion of the suite went."""

from __future__ import annotations

import math
from typing import Any

from bosdyn.api import geometry_pb2, lease_pb2, robot_command_pb2, synchronized_command_pb2
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.check import Basis, Check, Needs, check
from fake_robot.conformance.power import held, send, unpowered
from fake_robot.conformance.server import Server, SkippedError, enum_name, status_of
from fake_robot.conformance.session import Session, drive

_PROTO = "robot_command.proto"
_BASIC = "basic_command.proto"
FAR_S = 1e7
"""An end time that far ahead cannot be meant."""


def _refused(server: Server, command: Any, *expects: str, **keywords: Any) -> str:
    """The answer to a command without power, so that nothing can move.

    Raises:
        OpenError: The motors have power, or may have.
        SkippedError: The server refuses a command for want of power before it looks at end times and frames; the protos
            name no order.
    """
    with unpowered(server) as lease:
        seen = status_of(send(server, lease, command, **keywords))
        if seen == _UNPOWERED and seen not in expects:
            all_wrong = send(server, lease, _NOWHERE, clock=keywords.get("clock"), end_s=-1.0)
            if status_of(all_wrong) == _UNPOWERED:
                raise SkippedError("the server looks at the motors' power before what is wrong here")
        return seen


@check("RobotCommand.RobotCommand: lease", "a stop, no lease", "STATUS_INVALID_LEASE", source=_PROTO)
def command_without_lease(server: Server) -> str:
    """Stop, without a lease."""
    answer = send(server, lease_pb2.Lease(), RobotCommandBuilder.stop_command())
    return enum_name(answer, "lease_use_result.status")


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
    _refusal(
        "joint_control_without_power",
        "joint_request",
        "joint control, motors off",
        RobotCommandBuilder.joint_command(),
        _UNPOWERED,
    ),
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
    with held(server) as lease:
        return status_of(server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=0xFFFFFFF0))


def _answered(name: str, rpc: str, sends: str, told: str, expects: str, basis: Basis = Basis.DOCUMENTED) -> Check:
    """What was answered in the one motion of the suite."""

    def probe(server: Server) -> str:
        return server.once(drive).answer(told)

    return Check(name, rpc, sends, (expects,), basis, _BASIC, Needs.MOTION, "", probe)


SESSION = (
    _answered("power_comes", "Power.PowerCommand", "motors on", "power", "STATUS_SUCCESS"),
    _answered("stand_ends", "RobotCommand.RobotCommandFeedback", "a stand", "stand", "standing"),
    _answered(
        "velocity_times_out",
        "RobotCommand.RobotCommandFeedback",
        "a velocity for 4 s, in the body frame, and 2 s more",
        "velocity ended",
        "STATUS_COMMAND_TIMED_OUT",
        Basis.MEASURED,
    ),
    _answered(
        "trajectory_arrives", "RobotCommand.RobotCommandFeedback", "half a metre ahead", "trajectory ended", "stopped"
    ),
    _answered(
        "power_goes",
        "RobotCommand.RobotCommand: safe_power_off",
        "a sit, motors off",
        "off",
        "it sat down and is off again",
    ),
)


@check(
    "RobotCommand.RobotCommand: robot_command_id", "three commands", "three numbers", source=_PROTO, needs=Needs.MOTION
)
def commands_have_numbers(server: Server) -> str:
    """Each command that is taken has a number of its own."""
    session: Session = server.once(drive)
    session.piece("going")
    ids = set(session.command_ids) - {0}
    return "three numbers" if len(ids) == len(session.command_ids) == 3 else f"numbers {session.command_ids}"
