"""Errors that a server of Spot's API can have, each as a change of what a right one receives or answers.

They were listed from the vendor's API, not from the checks of ``spot-rl fake-robot conformance``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from google.protobuf.timestamp_pb2 import Timestamp

NS_PER_S = 1_000_000_000
CLOCK_ERROR_S = 199.0

AUTH = "AuthService/GetAuthToken"
ROBOT_ID = "RobotIdService/GetRobotId"
SERVICES = "DirectoryService/ListServiceEntries"
SERVICE = "DirectoryService/GetServiceEntry"
LICENCE = "LicenseService/GetLicenseInfo"
FEATURES = "LicenseService/GetFeatureEnabled"
TIME_SYNC = "TimeSyncService/TimeSyncUpdate"
STATE = "RobotStateService/GetRobotState"
STREAM = "RobotStateStreamingService/GetRobotStateStream"
ACQUIRE = "LeaseService/AcquireLease"
TAKE = "LeaseService/TakeLease"
RETURN = "LeaseService/ReturnLease"
RETAIN = "LeaseService/RetainLease"
LEASES = "LeaseService/ListLeases"
ESTOP_REGISTER = "EstopService/RegisterEstopEndpoint"
ESTOP_CHECK_IN = "EstopService/EstopCheckIn"
ESTOP_STATUS = "EstopService/GetEstopSystemStatus"
POWER = "PowerService/PowerCommand"
POWER_FEEDBACK = "PowerService/PowerCommandFeedback"
COMMAND = "RobotCommandService/RobotCommand"
FEEDBACK = "RobotCommandService/RobotCommandFeedback"
CLEAR_FAULT = "RobotCommandService/ClearBehaviorFault"
JOINTS = "RobotCommandStreamingService/JointControlStream"
ANY = "*"

NAMED, SIBLING = "named", "sibling"
"""Sources of errors; see :class:`PlantedError`."""

Hook = Callable[[Any, Any, dict[str, Any]], Any]
"""Changes an answer or a stream's message in place, or returns what is sent instead: (request, answer, memory)."""


@dataclass
class PlantedError:
    """One error.

    Attributes:
        name: Unique.
        what: What is wrong with the server.
        source: ``outside`` or, later, ``named`` if others planted it and it was missed; ``sibling`` if it is a relative
            of one that was, ``own`` otherwise.
        needs_motion: Whether it shows only on a robot with power.
        asks: What it changes in requests before the right server sees them, by method.
        answers: What it changes in answers and streams, by method.
    """

    name: str
    what: str
    source: str
    needs_motion: bool
    asks: dict[str, Hook] = field(default_factory=dict)
    answers: dict[str, Hook] = field(default_factory=dict)


ERRORS: dict[str, PlantedError] = {}


def planted(
    answers: str = "", *, asks: str = "", source: str = "own", needs_motion: bool = False, of: str = ""
) -> Callable[[Hook], Hook]:
    """Enter a function as an error, or as a further part of the error ``of``; method names are separated by spaces."""

    def enter(hook: Hook) -> Hook:
        name = of or hook.__name__
        error = ERRORS.setdefault(name, PlantedError(name, hook.__doc__ or "", source, needs_motion))
        error.asks |= dict.fromkeys(asks.split(), hook)
        error.answers |= dict.fromkeys(answers.split(), hook)
        return hook

    return enter


def changed(
    name: str, what: str, methods: str, path: str, value: Any, *, source: str = "own", needs_motion: bool = False
) -> None:
    """Enter an error of one field: another value, what a function makes of it, or None for none at all.

    A star in the path stands for every element of a repeated field.
    """
    *parents, field_name = path.split(".")

    def change(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
        messages = [answer]
        for parent in parents:
            found = messages if parent == "*" else [getattr(message, parent) for message in messages]
            messages = [part for message in found for part in message] if parent == "*" else found
        for message in messages:
            if value is None:
                message.ClearField(field_name)
            else:
                setattr(message, field_name, value(getattr(message, field_name)) if callable(value) else value)

    change.__name__, change.__doc__ = name, what
    planted(methods, source=source, needs_motion=needs_motion)(change)


def shift(stamp: Timestamp, seconds: float) -> None:
    """Move a stamp by some seconds."""
    stamp.FromNanoseconds(stamp.ToNanoseconds() + round(seconds * NS_PER_S))


def kinematics(answer: Any) -> Any:
    """The kinematic state of a poll or of a streamed state."""
    return answer.robot_state.kinematic_state if hasattr(answer, "robot_state") else answer.kinematic_state


def velocities(answer: Any) -> list[Any]:
    """The body's velocities of a poll or of a streamed state, in odom and in vision."""
    moving = kinematics(answer)
    return [moving.velocity_of_body_in_odom, moving.velocity_of_body_in_vision]


def rotated(q: Any, v: Any, *, back: bool) -> tuple[float, float, float]:
    """A vector turned by a quaternion, or back by it."""
    w, x, y, z = q.w, q.x, q.y, q.z
    if back:
        x, y, z = -x, -y, -z
    tx, ty, tz = 2 * (y * v.z - z * v.y), 2 * (z * v.x - x * v.z), 2 * (x * v.y - y * v.x)
    return (
        v.x + w * tx + y * tz - z * ty,
        v.y + w * ty + z * tx - x * tz,
        v.z + w * tz + x * ty - y * tx,
    )


def joint_states(answer: Any) -> Any:
    """A poll's joints."""
    return answer.robot_state.kinematic_state.joint_states


def scaled(name: str, what: str, values: str, factor: float, *, source: str) -> None:
    """Enter an error of both reports: one row of the joints is scaled."""

    def scale(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
        if hasattr(answer, "robot_state"):
            for joint in joint_states(answer):
                getattr(joint, values).value *= factor
        else:
            told = getattr(answer.joint_states, values)
            told[:] = [factor * value for value in told]

    scale.__name__, scale.__doc__ = name, what
    planted(f"{STATE} {STREAM}", source=source, needs_motion=True)(scale)
