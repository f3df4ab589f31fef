"""What a ``RobotCommand`` asks for, in the robot's own verbs. No gRPC."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from bosdyn.api import robot_command_pb2

from fake_robot.network.status import Snapshot
from fake_robot.network.walk_plan import WalkPlan
from fake_robot.robot.robot import Robot
from fake_robot.services.calls.stamps import ns_from_timestamp
from fake_robot.services.motion.refusals import InvalidCommandError, UnsupportedCommandError
from fake_robot.services.motion.stance_params import FootTargets, read_stance
from fake_robot.services.motion.stand_params import BodyCourse, read_course, stand_poses
from fake_robot.services.motion.walk_params import WalkBounds, read_trajectory, read_velocity


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


@dataclass(frozen=True)
class Command:
    """One command: the verb, whether it came as a synchronised command, and what the verb needs."""

    verb: Verb
    is_synchronized: bool
    course: BodyCourse = BodyCourse()
    end_stamp_ns: int | None = None
    """Robot time; None for a command without an end time, 0 for one that should bear it and does not."""
    plan: Callable[[Snapshot], WalkPlan] | None = None
    feet: FootTargets | None = None
    request: Any = None
    """The vendor's message of a walk, which its feedback echoes."""


def parse(command: robot_command_pb2.RobotCommand, bounds: WalkBounds) -> Command:
    """Read a command.

    Raises:
        RefusedCommandError: It is empty, its parameters cannot be read, or it asks for a motion, a frame, an arm or a
            gripper that the fake has not.
    """
    kind = command.WhichOneof("command")
    if kind == "full_body_command":
        return Command(_verb(command.full_body_command.WhichOneof("command"), kind, _FULL_BODY), is_synchronized=False)
    if kind != "synchronized_command":
        raise InvalidCommandError("the command is empty; set full_body_command or synchronized_command")
    synchronized = command.synchronized_command
    for part in ("arm_command", "gripper_command"):
        if synchronized.HasField(part):
            raise UnsupportedCommandError(f"the robot has no arm, so it cannot follow {part}")
    mobility = synchronized.mobility_command
    verb = _verb(mobility.WhichOneof("command"), kind, _MOBILITY)
    params = mobility.params if mobility.HasField("params") else None
    if verb in TIMED:
        return _timed(verb, getattr(mobility, f"{verb.value}_request"), params, bounds)
    if verb is Verb.STAND and params is not None:
        return Command(verb, is_synchronized=True, course=read_course(params))
    return Command(verb, is_synchronized=True)


def start(command: Command, robot: Robot) -> None:
    """Have the robot begin.

    Raises:
        RefusedCommandError: The body's course is in a frame that the robot has not, or feet are out of reach.
    """
    if command.verb is Verb.STAND:
        robot.stand(stand_poses(command.course, robot.snapshot()))
    elif command.plan is not None:
        robot.walk(command.plan(robot.snapshot()))
    elif command.feet is not None:
        robot.place_feet(command.feet.in_odom_m(robot.snapshot()), command.feet.accuracy_m)
    else:
        begin = {
            Verb.SIT: robot.sit,
            Verb.STOP: robot.stop_motion,
            Verb.FREEZE: robot.freeze,
            Verb.SELFRIGHT: robot.selfright,
            Verb.SAFE_POWER_OFF: robot.safe_power_off,
            Verb.JOINT: robot.enter_joint_control,
        }
        begin[command.verb]()


def _timed(verb: Verb, request: Any, params: Any, bounds: WalkBounds) -> Command:
    end_ns = ns_from_timestamp(request.end_time) if request.HasField("end_time") else 0
    if verb is Verb.STANCE:
        return Command(verb, is_synchronized=True, end_stamp_ns=end_ns, feet=read_stance(request))
    read = read_velocity if verb is Verb.SE2_VELOCITY else read_trajectory
    plan = read(request, params, bounds)
    return Command(verb, is_synchronized=True, end_stamp_ns=end_ns, plan=plan, request=request)


def _verb(field: str | None, kind: str, known: tuple[str, ...]) -> Verb:
    if field is None:
        raise InvalidCommandError(f"{kind} is empty; set one of its commands")
    name = field.removesuffix("_request")
    if name not in known:
        raise UnsupportedCommandError(f"a base robot does not know {field} of {kind}; it knows {', '.join(known)}")
    return Verb(name)
