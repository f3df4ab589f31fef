"""Checks of robot commands: what is refused before anything moves, and how the one motion of the suite went."""

from __future__ import annotations

import math
from typing import Any

from bosdyn.api import geometry_pb2, lease_pb2, robot_command_pb2, synchronized_command_pb2
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.check import Basis, Check, Needs, check
from fake_robot.conformance.power import SAT_DOWN, held, send, unpowered
from fake_robot.conformance.server import Server, SkippedError, enum_name, status_of
from fake_robot.conformance.session import drive

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


@check("RobotCommand: lease", "a stop, no lease", "STATUS_INVALID_LEASE", source=_PROTO)
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

_JOINTS = RobotCommandBuilder.joint_command()
_EMPTY = robot_command_pb2.RobotCommand(synchronized_command=synchronized_command_pb2.SynchronizedCommand.Request())

_CLOCK, _END, _FRAME = "clock_identifier", "end_time", "se2_frame_name"
_INVALID, _NO_TIME_SYNC = "STATUS_INVALID_REQUEST", "STATUS_NO_TIMESYNC"
_EXPIRED, _UNPOWERED = "STATUS_EXPIRED", "STATUS_NOT_POWERED_ON"
_CLOCK_SWITCH = "services.clock_identifier_check"


def _refusal(
    name: str, field: str, sends: str, command: Any, *expects: str, switch: str = "", is_guess: bool = False, **how: Any
) -> Check:
    """A command that is refused while the motors are off; ``how`` as of :func:`send`."""

    def probe(server: Server) -> str:
        return _refused(server, command, *expects, **how)

    basis = Basis.GUESS if is_guess else Basis.DOCUMENTED
    return Check(name, f"RobotCommand: {field}", sends, expects, basis, _PROTO, Needs.LEASE, switch, probe)


def _guess(name: str, field: str, sends: str, command: Any, *expects: str, **how: Any) -> Check:
    return _refusal(name, field, sends, command, *expects, is_guess=True, **how)


# fmt: off
REFUSALS = (
    _refusal("empty_command", "command", "an empty command", robot_command_pb2.RobotCommand(), _INVALID),
    _guess("empty_synchronized_command", "command", "a synchronized command that is empty", _EMPTY, _INVALID),
    _refusal("timed_without_clock", _CLOCK, "a timed command, no identifier", _AT_REST, _NO_TIME_SYNC,
             clock="", switch=_CLOCK_SWITCH),
    _refusal("timed_with_unknown_clock", _CLOCK, "a timed command, one never given", _AT_REST, _NO_TIME_SYNC,
             clock="no-such-client", switch=_CLOCK_SWITCH),
    _guess("stand_without_clock", _CLOCK, "a stand, no identifier", _STAND, _NO_TIME_SYNC, _UNPOWERED,
           clock="", switch=_CLOCK_SWITCH),
    _refusal("stand_without_power", "stand", "motors off", _STAND, _UNPOWERED),
    _refusal("joint_control_without_power", "joint_request", "motors off", _JOINTS, _UNPOWERED),
    _refusal("expired_command", _END, "an end time that has passed", _AT_REST, _EXPIRED, end_s=-1.0),
    _refusal("distant_command", _END, "an end time months ahead", _AT_REST, "STATUS_TOO_DISTANT",
             end_s=FAR_S, switch="services.max_command_duration_s"),
    _refusal("command_without_end", _END, "none; the proto names no status", _AT_REST, _EXPIRED, _INVALID,
             end_s=None, switch="services.missing_end_time_refusal"),
    _refusal("unknown_frame", _FRAME, "a velocity in an unknown frame", _NOWHERE, "STATUS_UNKNOWN_FRAME"),
    _refusal("unknown_trajectory_frame", _FRAME, "a trajectory in an unknown frame",
             RobotCommandBuilder.synchro_se2_trajectory_command(_HERE, "no-such-frame"), "STATUS_UNKNOWN_FRAME"),
    _guess("velocity_not_a_number", "velocity", "NaN",
           RobotCommandBuilder.synchro_velocity_command(math.nan, 0.0, 0.0), _INVALID, _UNPOWERED),
    _guess("trajectory_without_points", "trajectory", "no point", _TO_NOWHERE, _INVALID, _UNPOWERED),
    _guess("stance_of_three_feet", "foot_positions", "three feet", _ON_THREE_FEET, _INVALID, _UNPOWERED),
)
# fmt: on


@check("RobotCommand: arm_command", "no arm", "STATUS_UNSUPPORTED", source=_PROTO, needs=Needs.LEASE)
def arm_command(server: Server) -> str:
    """Stow an arm that is not there."""
    if server.state().HasField("manipulator_state"):
        raise SkippedError("the robot has an arm")
    return _refused(server, RobotCommandBuilder.arm_stow_command())


@check("ClearBehaviorFault", "an unknown number", "STATUS_NOT_CLEARED", source=_PROTO, needs=Needs.LEASE)
def clear_no_fault(server: Server) -> str:
    """Clear an unknown fault."""
    with held(server) as lease:
        return status_of(server.ask("robot-command", "ClearBehaviorFault", lease=lease, behavior_fault_id=0xFFFFFFF0))


def _answered(name: str, rpc: str, sends: str, expects: str, basis: Basis = Basis.DOCUMENTED) -> Check:
    """What was answered in the one motion of the suite, under the check's name."""

    def probe(server: Server) -> str:
        session = server.once(drive)
        return session.got(session.told, name)

    return Check(name, rpc, sends, (expects,), basis, _BASIC, Needs.MOTION, "", probe)


# fmt: off
SESSION = (
    _answered("power_comes", "PowerCommandFeedback", "motors on", "STATUS_SUCCESS"),
    _answered("stand_ends", "RobotCommandFeedback", "a stand", "STATUS_IS_STANDING"),
    _answered("velocity_times_out", "RobotCommandFeedback", "a velocity for 4 s, in the body frame, and 2 s more",
              "STATUS_COMMAND_TIMED_OUT", Basis.MEASURED),
    _answered("trajectory_arrives", "RobotCommandFeedback", "half a metre ahead", "STATUS_STOPPED"),
    _answered("commands_have_numbers", "RobotCommand: robot_command_id", "three commands", "three numbers"),
    _answered("power_goes", "RobotCommand: safe_power_off", "a sit, motors off", SAT_DOWN),
)
# fmt: on
