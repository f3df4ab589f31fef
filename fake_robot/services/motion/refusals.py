"""Why the robot refuses a command, each with the status that the proto names. No gRPC."""

from __future__ import annotations

from bosdyn.api import robot_command_pb2

Response = robot_command_pb2.RobotCommandResponse


class RefusedCommandError(Exception):
    """The robot does not take the command; the message says why."""

    status: int


class InvalidCommandError(RefusedCommandError):
    """The command makes no sense."""

    status = Response.STATUS_INVALID_REQUEST


class UnsupportedCommandError(RefusedCommandError):
    """The fake has no such motion; the message says which it has."""

    status = Response.STATUS_UNSUPPORTED


class UnknownFrameError(RefusedCommandError):
    """The command is in a frame that the robot has not, or not for this command."""

    status = Response.STATUS_UNKNOWN_FRAME


class ExpiredCommandError(RefusedCommandError):
    """The command's end time has passed."""

    status = Response.STATUS_EXPIRED


class TooDistantCommandError(RefusedCommandError):
    """The command's end time lies too far ahead."""

    status = Response.STATUS_TOO_DISTANT


class NotPoweredOnError(RefusedCommandError):
    """The motors have no power, or are about to lose it."""

    status = Response.STATUS_NOT_POWERED_ON


class BehaviorFaultError(RefusedCommandError):
    """A behaviour fault has to be cleared first."""

    status = Response.STATUS_BEHAVIOR_FAULT
