"""What a ``RobotCommand`` asks for, in the robot's own verbs, and how that goes, in the vendor's messages. No gRPC."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from bosdyn.api import basic_command_pb2, robot_command_pb2

from fake_robot.network.requests import WalkProgress
from fake_robot.network.status import EstopLevel, Mode, MotorPower, Snapshot, StanceProgress
from fake_robot.robot.robot import Robot
from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.calls import ns_of
from fake_robot.services.motion.parameters import (
    BodyCourse,
    RefusedCommandError,
    read_course,
    read_stance,
    read_trajectory,
    read_velocity,
    stand_poses,
)


class Verb(enum.Enum):
    """The motions that the fake knows. The value is the field's name in the vendor's message, less ``_request``."""

    STAND = "stand"
    SIT = "sit"
    STOP = "stop"
    FREEZE = "freeze"
    SELFRIGHT = "selfright"
    SAFE_POWER_OFF = "safe_power_off"
    JOINT = "joint"
    SE2_VELOCITY = "se2_velocity"
    SE2_TRAJECTORY = "se2_trajectory"
    STANCE = "stance"


WALKS: Final = (Verb.SE2_VELOCITY, Verb.SE2_TRAJECTORY)
TIMED: Final = (*WALKS, Verb.STANCE)
"""Commands that must bear an end time."""
_FULL_BODY: Final = ("stop", "freeze", "selfright", "safe_power_off", "joint")
_MOBILITY: Final = ("stand", "sit", "stop", "freeze", "se2_velocity", "se2_trajectory", "stance")
_BEGIN: Final[dict[Verb, Callable[[Robot], None]]] = {
    Verb.SIT: lambda robot: robot.sit(),
    Verb.STOP: lambda robot: robot.stop_motion(),
    Verb.FREEZE: lambda robot: robot.freeze(),
    Verb.SELFRIGHT: lambda robot: robot.selfright(),
    Verb.SAFE_POWER_OFF: lambda robot: robot.safe_power_off(),
    Verb.JOINT: lambda robot: robot.enter_joint_control(),
}
"""What the commands without parameters begin."""


@dataclass(frozen=True)
class Command:
    """One command: the verb, whether it came as a synchronised command, and what has the robot begin.

    ``begin`` raises RefusedCommandError where the robot has no such frame, or feet are out of reach.
    """

    verb: Verb
    is_synchronized: bool
    begin: Callable[[Robot], None]
    end_stamp_ns: int | None = None
    """Robot time; None for a command without an end time, 0 for one that should bear it and does not."""
    request: Any = None
    """The vendor's message of a timed command; the feedback of a walk echoes it."""


def parse(command: robot_command_pb2.RobotCommand, config: ServicesConfig) -> Command:
    """Read a command.

    Raises:
        RefusedCommandError: It is empty, its parameters cannot be read, or it asks for a motion, a frame, an arm or a
            gripper that the fake has not.
    """
    kind = command.WhichOneof("command")
    if kind == "full_body_command":
        verb = _verb(command.full_body_command.WhichOneof("command"), kind, _FULL_BODY)
        return Command(verb, is_synchronized=False, begin=_BEGIN[verb])
    if kind != "synchronized_command":
        raise RefusedCommandError(
            "INVALID_REQUEST", "the command is empty; set full_body_command or synchronized_command"
        )
    for part in ("arm_command", "gripper_command"):
        if command.synchronized_command.HasField(part):
            raise RefusedCommandError(
                "UNSUPPORTED", f"there is no arm that follows {part}; one of a fake robot follows joint control"
            )
    mobility = command.synchronized_command.mobility_command
    verb = _verb(mobility.WhichOneof("command"), kind, _MOBILITY)
    params = mobility.params if mobility.HasField("params") else None
    if verb in TIMED:
        request = getattr(mobility, f"{verb.value}_request")
        end_ns = ns_of(request.end_time) if request.HasField("end_time") else 0
        return Command(verb, True, _beginning(verb, request, params, config), end_ns, request)
    if verb is Verb.STAND:
        course = BodyCourse() if params is None else read_course(params)
        return Command(verb, True, lambda robot: robot.stand(stand_poses(course, robot.snapshot())))
    return Command(verb, True, _BEGIN[verb])


def _beginning(verb: Verb, request: Any, params: Any, config: ServicesConfig) -> Callable[[Robot], None]:
    """What has the robot begin a timed command."""
    if verb is Verb.STANCE:
        feet_in_odom_m, accuracy_m = read_stance(request)
        return lambda robot: robot.place_feet(feet_in_odom_m(robot.snapshot()), accuracy_m)
    plan = (read_velocity if verb is Verb.SE2_VELOCITY else read_trajectory)(request, params, config)
    return lambda robot: robot.walk(plan(robot.snapshot()))


def _verb(field: str | None, kind: str, known: tuple[str, ...]) -> Verb:
    if field is None:
        raise RefusedCommandError("INVALID_REQUEST", f"{kind} is empty; set one of its commands")
    name = field.removesuffix("_request")
    if name not in known:
        raise RefusedCommandError(
            "UNSUPPORTED", f"a base robot does not know {field} of {kind}; it knows {', '.join(known)}"
        )
    return Verb(name)


Feedback = basic_command_pb2.RobotCommandFeedbackStatus
_Trajectory = basic_command_pb2.SE2TrajectoryCommand.Feedback
_STANCE = {
    StanceProgress.REACHED: basic_command_pb2.StanceCommand.Feedback.STATUS_STANCED,
    StanceProgress.TOO_FAR: basic_command_pb2.StanceCommand.Feedback.STATUS_TOO_FAR_AWAY,
}


def feedback(command: Command, snapshot: Snapshot, *, is_current: bool) -> robot_command_pb2.RobotCommandFeedback:
    """How a command goes.

    One that a newer command replaced is OVERRIDDEN, one whose end time has passed TIMED_OUT. One that lost the motors
    to an e-stop or a fault is ROBOT_FROZEN.
    """
    message = robot_command_pb2.RobotCommandFeedback()
    if command.is_synchronized:
        part = message.synchronized_feedback.mobility_command_feedback
    else:
        part = message.full_body_feedback
    part.status = _status(command, snapshot, is_current=is_current)
    inner = getattr(part, f"{command.verb.value}_feedback")
    inner.SetInParent()
    _fill(inner, command, snapshot, is_current=is_current)
    return message


def _fill(inner: Any, command: Command, snapshot: Snapshot, *, is_current: bool) -> None:
    verb, mode = command.verb, snapshot.mode
    if verb is Verb.STAND:
        is_done = mode is Mode.STANDING
        inner.status = inner.STATUS_IS_STANDING if is_done else inner.STATUS_IN_PROGRESS
        inner.standing_state = inner.STANDING_CONTROLLED if is_done else inner.STANDING_UNKNOWN
    elif verb is Verb.SIT:
        inner.status = inner.STATUS_IS_SITTING if mode is Mode.SITTING else inner.STATUS_IN_PROGRESS
    elif verb is Verb.SELFRIGHT:
        inner.status = inner.STATUS_COMPLETED if mode is Mode.SITTING else inner.STATUS_IN_PROGRESS
    elif verb is Verb.SAFE_POWER_OFF:
        is_done = snapshot.motor_power is MotorPower.OFF
        inner.status = inner.STATUS_POWERED_OFF if is_done else inner.STATUS_IN_PROGRESS
    elif verb is Verb.JOINT:
        is_active = is_current and mode is Mode.JOINT_CONTROL and not snapshot.is_joint_control_failed
        inner.status = inner.STATUS_ACTIVE if is_active else inner.STATUS_ERROR
        inner.num_messages_received = snapshot.joint_commands_received
    elif verb is Verb.SE2_TRAJECTORY:
        _fill_trajectory(inner, snapshot)
    elif verb is Verb.STANCE:
        inner.status = _STANCE.get(snapshot.stance_progress, inner.STATUS_GOING_TO_STANCE)
    if command.verb in WALKS:
        inner.request_information.CopyFrom(command.request)


def _fill_trajectory(inner: Any, snapshot: Snapshot) -> None:
    """The robot has stopped once it stands again after the walk."""
    progress, is_standing = snapshot.walk_progress, snapshot.mode is Mode.STANDING
    is_over = progress in {WalkProgress.ARRIVED, WalkProgress.TIMED_OUT}
    if is_over and is_standing:
        inner.status, inner.body_movement_status = _Trajectory.STATUS_STOPPED, _Trajectory.BODY_STATUS_SETTLED
        is_there = progress is WalkProgress.ARRIVED
        inner.final_goal_status = (
            _Trajectory.FINAL_GOAL_STATUS_ACHIEVABLE if is_there else _Trajectory.FINAL_GOAL_STATUS_BLOCKED
        )
        return
    is_near = is_over or progress is WalkProgress.ARRIVING
    inner.status = _Trajectory.STATUS_STOPPING if is_near else _Trajectory.STATUS_IN_PROGRESS
    inner.body_movement_status = _Trajectory.BODY_STATUS_MOVING
    inner.final_goal_status = _Trajectory.FINAL_GOAL_STATUS_IN_PROGRESS


def _status(command: Command, snapshot: Snapshot, *, is_current: bool) -> int:
    if not is_current:
        return int(Feedback.STATUS_COMMAND_OVERRIDDEN)
    is_power_lost = snapshot.motor_power is not MotorPower.ON and command.verb is not Verb.SAFE_POWER_OFF
    is_stopped = snapshot.estop_level is not EstopLevel.NONE or bool(snapshot.behavior_faults)
    if is_power_lost or (is_stopped and command.verb is not Verb.SAFE_POWER_OFF):
        return int(Feedback.STATUS_ROBOT_FROZEN)
    if command.end_stamp_ns is not None and snapshot.robot_stamp_ns > command.end_stamp_ns:
        has_arrived = command.verb is Verb.SE2_TRAJECTORY and snapshot.walk_progress is WalkProgress.ARRIVED
        has_stanced = command.verb is Verb.STANCE and snapshot.stance_progress is StanceProgress.REACHED
        if not (has_arrived or has_stanced):
            return int(Feedback.STATUS_COMMAND_TIMED_OUT)
    return int(Feedback.STATUS_PROCESSING)
