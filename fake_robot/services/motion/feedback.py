"""How a command goes, in the vendor's messages. No gRPC."""

from __future__ import annotations

from typing import Any

from bosdyn.api import basic_command_pb2, robot_command_pb2

from fake_robot.network.status import EstopLevel, Mode, MotorPower, Snapshot, StanceProgress
from fake_robot.network.walk_plan import WalkProgress
from fake_robot.services.motion.commands import WALKS, Command, Verb

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
