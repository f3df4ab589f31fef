"""What a ``RobotCommand`` asks for, in the robot's own verbs; and its feedback. No gRPC."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from bosdyn.api import basic_command_pb2, robot_command_pb2

from fake_robot.network.robot_port import EstopLevel, Mode, MotorPower, RobotPort, Snapshot
from fake_robot.services.motion.stand_params import BodyCourse, InvalidCommandError, read_course, stand_poses

Feedback = basic_command_pb2.RobotCommandFeedbackStatus


class Verb(enum.Enum):
    """The motions that the fake knows. The value is the field's name in the vendor's message, less ``_request``."""

    STAND = "stand"
    SIT = "sit"
    STOP = "stop"
    FREEZE = "freeze"
    SELFRIGHT = "selfright"
    SAFE_POWER_OFF = "safe_power_off"
    JOINT = "joint"


@dataclass(frozen=True)
class Command:
    """One command: the verb, whether it came as a synchronised command, and the body's course in a stand."""

    verb: Verb
    is_synchronized: bool
    course: BodyCourse = BodyCourse()


class UnsupportedCommandError(Exception):
    """The fake has no such motion; the message says which it has."""


TIMED = ("se2_velocity_request", "se2_trajectory_request", "stance_request")
"""Mobility commands that bear an end time."""


def is_timed(command: robot_command_pb2.RobotCommand) -> bool:
    """Whether the command bears an end time."""
    return command.synchronized_command.mobility_command.WhichOneof("command") in TIMED


def parse(command: robot_command_pb2.RobotCommand) -> Command:
    """Read a command.

    Raises:
        InvalidCommandError: It is empty, or its parameters cannot be read.
        UnsupportedCommandError: It asks for a motion, an arm or a gripper that the fake has not.
    """
    kind = command.WhichOneof("command")
    if kind == "full_body_command":
        return Command(_verb(command.full_body_command.WhichOneof("command"), kind), is_synchronized=False)
    if kind != "synchronized_command":
        raise InvalidCommandError("the command is empty; set full_body_command or synchronized_command")
    synchronized = command.synchronized_command
    for part in ("arm_command", "gripper_command"):
        if synchronized.HasField(part):
            raise UnsupportedCommandError(f"the robot has no arm, so it cannot follow {part}")
    mobility = synchronized.mobility_command
    verb = _verb(mobility.WhichOneof("command"), kind)
    if verb is not Verb.STAND or not mobility.HasField("params"):
        return Command(verb, is_synchronized=True)
    return Command(verb, is_synchronized=True, course=read_course(mobility.params))


def start(command: Command, robot: RobotPort) -> None:
    """Have the robot begin.

    Raises:
        UnknownFrameError: The body's course is in a frame that the robot has not.
    """
    if command.verb is Verb.STAND:
        robot.stand(stand_poses(command.course, robot.snapshot()))
        return
    begin = {
        Verb.SIT: robot.sit,
        Verb.STOP: robot.stop_motion,
        Verb.FREEZE: robot.freeze,
        Verb.SELFRIGHT: robot.selfright,
        Verb.SAFE_POWER_OFF: robot.safe_power_off,
        Verb.JOINT: robot.enter_joint_control,
    }
    begin[command.verb]()


def feedback(command: Command, snapshot: Snapshot, *, is_current: bool) -> robot_command_pb2.RobotCommandFeedback:
    """How a command goes.

    One that a newer command replaced is OVERRIDDEN. One that lost the motors to an e-stop or a fault is ROBOT_FROZEN.
    """
    message = robot_command_pb2.RobotCommandFeedback()
    if command.is_synchronized:
        part = message.synchronized_feedback.mobility_command_feedback
    else:
        part = message.full_body_feedback
    part.status = _status(command, snapshot, is_current=is_current)
    inner = getattr(part, f"{command.verb.value}_feedback")
    inner.SetInParent()
    if command.verb is Verb.STAND:
        is_done = snapshot.mode is Mode.STANDING
        inner.status = inner.STATUS_IS_STANDING if is_done else inner.STATUS_IN_PROGRESS
        inner.standing_state = inner.STANDING_CONTROLLED if is_done else inner.STANDING_UNKNOWN
    elif command.verb is Verb.SIT:
        is_done = snapshot.mode is Mode.SITTING
        inner.status = inner.STATUS_IS_SITTING if is_done else inner.STATUS_IN_PROGRESS
    elif command.verb is Verb.SELFRIGHT:
        is_done = snapshot.mode is Mode.SITTING
        inner.status = inner.STATUS_COMPLETED if is_done else inner.STATUS_IN_PROGRESS
    elif command.verb is Verb.SAFE_POWER_OFF:
        is_done = snapshot.motor_power is MotorPower.OFF
        inner.status = inner.STATUS_POWERED_OFF if is_done else inner.STATUS_IN_PROGRESS
    elif command.verb is Verb.JOINT:
        is_active = is_current and snapshot.mode is Mode.JOINT_CONTROL and not snapshot.is_joint_control_failed
        inner.status = inner.STATUS_ACTIVE if is_active else inner.STATUS_ERROR
        inner.num_messages_received = snapshot.joint_commands_received
    return message


def _status(command: Command, snapshot: Snapshot, *, is_current: bool) -> int:
    if not is_current:
        return int(Feedback.STATUS_COMMAND_OVERRIDDEN)
    is_power_lost = snapshot.motor_power is not MotorPower.ON and command.verb is not Verb.SAFE_POWER_OFF
    is_stopped = snapshot.estop_level is not EstopLevel.NONE or bool(snapshot.behavior_faults)
    if is_power_lost or (is_stopped and command.verb is not Verb.SAFE_POWER_OFF):
        return int(Feedback.STATUS_ROBOT_FROZEN)
    return int(Feedback.STATUS_PROCESSING)


def _verb(field: str | None, kind: str) -> Verb:
    if field is None:
        raise InvalidCommandError(f"{kind} is empty; set one of its commands")
    name = field.removesuffix("_request")
    known = [verb.value for verb in Verb]
    is_wrong_kind = kind == "synchronized_command" and name not in {"stand", "sit", "stop", "freeze"}
    if name not in known or is_wrong_kind:
        raise UnsupportedCommandError(
            f"the fake robot does not know {field} of {kind}; it knows {', '.join(known)}. "
            "To walk, send joint commands: joint, and a stream of set-points"
        )
    return Verb(name)
