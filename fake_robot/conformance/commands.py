"""Checks of robot commands and of the joint-control stream.

They tell what is refused before anything moves, and how the one motion of the suite went.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from bosdyn.api import (
    geometry_pb2,
    lease_pb2,
    robot_command_pb2,
    robot_command_service_pb2_grpc,
    synchronized_command_pb2,
)
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.check import Basis, ConformanceCheck, Needs, check
from fake_robot.conformance.power import SAT_DOWN, held, joint_request, send, unpowered
from fake_robot.conformance.recording import NAMES, RecordedPart, record_rest
from fake_robot.conformance.server import OpenError, Server, SkippedError, enum_name, status_of
from fake_robot.conformance.session import EXPIRED, HOLDING, SLOT_MESSAGES, WHILE_STANDING, MotionRecord, drive
from spot_model.robot.facts import N_JOINTS, STAND_KD_NM_S_PER_RAD, STAND_KP_NM_PER_RAD, Array

_JOINT_COMMAND = "robot_command.proto, basic_command.proto: JointCommand"
_ELEVEN, _WAIT = "eleven values", "joint_control.activation_wait_s"
_HOLD = "the stance, a push by the knees, and small steps"
_LOAD_NM = 8.0
"""Loads are measured to some N·m; a wrong sign or stiffness makes more than that."""
_SETTLED = 10
"""States after a step in which the inertia of motors takes part of the load."""
_GAINS = (0.75, 1.33)
"""Share of a gain, as measured: a quarter for friction and for how loads are measured."""
_STREAM_TIMEOUT_S = 30.0


def _request(server: Server, key: int = 1) -> Any:
    """A message that holds every joint where it is, with weak gains."""
    position_rad = server.once(record_rest).motions[0].position_rad[-1]
    ones = np.ones(N_JOINTS)
    return joint_request(server, np.array([position_rad, 0.0 * ones, 0.0 * ones]), ones, 0.1 * ones, key=key)


def _stream(server: Server, requests: Iterable[Any]) -> str:
    """The verdict of a stream of these messages, without power; one that is refused says why."""
    with unpowered(server):
        stub = robot_command_service_pb2_grpc.RobotCommandStreamingServiceStub(
            server.channel("robot-command-streaming")
        )
        answer = stub.JointControlStream(iter(requests), timeout=_STREAM_TIMEOUT_S)
    seen = status_of(answer)
    return seen if answer.message or seen == "STATUS_OK" else f"{seen}, without a word"


def _spoilt(
    name: str, field: str, sends: str, spoil: Callable[[Any], object], *expects: str, **more: Any
) -> ConformanceCheck:
    """One message in which a field is not as it must be."""

    def probe(server: Server) -> str:
        request = _request(server)
        spoil(request.joint_command if field != "contact_advice" else request)
        return _stream(server, [request])

    basis, switch = more.get("basis", Basis.DOCUMENTED), more.get("switch", "")
    expects = expects or ("STATUS_INVALID_REQUEST",)
    return ConformanceCheck(
        name, f"JointControlStream: {field}", sends, expects, basis, _JOINT_COMMAND, Needs.LEASE, switch, probe
    )


def _later(seconds: int) -> Callable[[Any], None]:
    return lambda command: setattr(command.end_time, "seconds", command.end_time.seconds + seconds)


# fmt: off
SPOILT = (
    _spoilt("stream_expired", "end_time", "a second ago", _later(-1), "STATUS_EXPIRED"),
    _spoilt("stream_too_distant", "end_time", "hours ahead", _later(10**5), "STATUS_TOO_DISTANT",
            switch="joint_control.max_end_time_ahead_s"),
    _spoilt("stream_without_end", "end_time", "none; the proto names no status", lambda c: c.ClearField("end_time"),
            "STATUS_EXPIRED", "STATUS_INVALID_REQUEST"),
    _spoilt("stream_of_eleven_positions", "position", _ELEVEN, lambda c: c.position.pop()),
    _spoilt("stream_of_eleven_velocities", "velocity", _ELEVEN, lambda c: c.velocity.pop()),
    _spoilt("stream_of_eleven_loads", "load", _ELEVEN, lambda c: c.load.pop()),
    _spoilt("stream_without_gains", "gains", "none in the first message", lambda c: c.ClearField("gains")),
    _spoilt("stream_of_partial_gains", "gains.k_q_p", _ELEVEN, lambda c: c.gains.k_q_p.pop()),
    _spoilt("stream_of_negative_gains", "gains.k_qd_p", "a negative gain",
            lambda c: c.gains.k_qd_p.__setitem__(0, -1.0), basis=Basis.GUESS),
    _spoilt("stream_of_nan", "position", "NaN", lambda c: c.position.__setitem__(0, math.nan), basis=Basis.GUESS),
    _spoilt("stream_of_negative_limit", "velocity_safety_limit", "a negative limit",
            lambda c: setattr(c.velocity_safety_limit, "value", -1.0)),
    _spoilt("stream_of_three_contacts", "contact_advice", "three values",
            lambda r: r.contact_advice.contact_advice.extend([1, 1, 1])),
)
# fmt: on


@check(
    "JointControlStream", "no joint control", "STATUS_INACTIVE", source=_JOINT_COMMAND, needs=Needs.LEASE, switch=_WAIT
)
def stream_while_inactive(server: Server) -> str:
    """Commands to a robot that nobody has put into joint control, for as long as it lets them come."""
    return _stream(server, _many(server))


def _many(server: Server) -> Iterator[Any]:
    """Commands at 50 Hz until the robot ends the stream."""
    for key in range(1, round(_STREAM_TIMEOUT_S * 50)):
        yield _request(server, key)
        time.sleep(0.02)


def _held(server: Server, part: str) -> tuple[RecordedPart, Array, Array]:
    """A recording of joint control, the keys of its commands, and what their three parts ask for, shape (n, 12, 3)."""
    session: MotionRecord = server.once(drive)
    if not session.ended_by and part not in session.pieces:
        raise SkippedError("joint control is not licensed")
    recording = session.got(session.pieces, part)
    motion, last = recording.streamed, max(session.asked)
    told = [state.last_command.user_command_key for state in recording.states]
    keys = np.array([last if part == EXPIRED else key for key in told])
    asked = np.array([session.asked[key] for key in keys.clip(1, last).tolist()])
    stiff_nm = STAND_KP_NM_PER_RAD * (asked[:, 0] - motion.position_rad)
    damped_nm = STAND_KD_NM_S_PER_RAD * (asked[:, 1] - motion.velocity_rad_s)
    return recording, keys, np.stack([stiff_nm, damped_nm, asked[:, 2]], axis=-1)


@check("JointControlStream", _HOLD, "the servo law, and the command's key", source=_JOINT_COMMAND, needs=Needs.MOTION)
def servo_law(server: Server) -> str:
    """Each joint's load answers to steps of what is asked for by the gains sent; states tell their command."""
    recording, keys, parts_nm = _held(server, HOLDING)
    if not 0 < keys[0] < keys[-1]:
        return f"keys {keys[0]} to {keys[-1]}"
    slots = keys // SLOT_MESSAGES
    is_settled = np.append(np.zeros(_SETTLED, bool), slots[_SETTLED:] == slots[:-_SETTLED])
    rows = [np.flatnonzero(is_settled & (slots == slot)) for slot in np.unique(slots[is_settled])]
    if len(rows) < 8:
        raise OpenError("too few states came")
    known = np.array([np.append(parts_nm[at].mean(axis=0), np.ones((N_JOINTS, 1)), axis=1) for at in rows])
    seen_nm = np.array([recording.streamed.load_nm[at].mean(axis=0) for at in rows])
    for i, name in enumerate(NAMES):
        *shares, off_nm = np.linalg.lstsq(known[:, i], seen_nm[:, i])[0]
        for what, share in zip(("stiffness", "damping", "load"), shares, strict=True):
            if not _GAINS[0] < share < _GAINS[1]:
                return f"{name}: {share:.2f} of the {what}"
        if abs(off_nm) > _LOAD_NM:
            return f"{name}: the load is {off_nm:.1f} N·m off"
    return "the servo law, and the command's key"


@check("JointControlStream: end_time", "nothing more", "no longer followed", source=_JOINT_COMMAND, needs=Needs.MOTION)
def stream_command_ends(server: Server) -> str:
    """Two seconds after the last command of an open stream, and so after its end time, no joint follows it."""
    recording, _, parts_nm = _held(server, EXPIRED)
    off_nm = np.median(np.abs(recording.streamed.load_nm - parts_nm.sum(axis=-1)), axis=0)
    return "still followed" if off_nm.max() < _LOAD_NM else "no longer followed"


_PROTO = "robot_command.proto"


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
                raise SkippedError("the server looks at the motors' power before what is wrong here: --with-motion")
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
) -> ConformanceCheck:
    """A command that is refused while the motors are off; ``how`` as of :func:`send`."""

    def probe(server: Server) -> str:
        try:
            return _refused(server, command, *expects, **how)
        except SkippedError:
            if name not in WHILE_STANDING or not server.may_move:
                raise
        session: MotionRecord = server.once(drive)
        return session.got(session.told, name)

    if not is_guess and _UNPOWERED not in expects and command.WhichOneof("command"):
        WHILE_STANDING[name] = lambda server, lease: status_of(send(server, lease, command, **how))
    basis = Basis.GUESS if is_guess else Basis.DOCUMENTED
    return ConformanceCheck(name, f"RobotCommand: {field}", sends, expects, basis, _PROTO, Needs.LEASE, switch, probe)


def _guess(name: str, field: str, sends: str, command: Any, *expects: str, **how: Any) -> ConformanceCheck:
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
             # An end time that far ahead cannot be meant.
             end_s=1e7, switch="services.max_command_duration_s"),
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


def _answered(name: str, rpc: str, sends: str, expects: str, basis: Basis = Basis.DOCUMENTED) -> ConformanceCheck:
    """What was answered in the one motion of the suite, under the check's name."""

    def probe(server: Server) -> str:
        session = server.once(drive)
        return session.got(session.told, name)

    return ConformanceCheck(name, rpc, sends, (expects,), basis, "basic_command.proto", Needs.MOTION, "", probe)


# fmt: off
SESSION = (
    _answered("power_comes", "PowerCommandFeedback", "motors on", "STATUS_SUCCESS"),
    _answered("stand_ends", "RobotCommandFeedback", "a stand", "STATUS_IS_STANDING"),
    _answered("velocity_times_out", "RobotCommandFeedback", "a velocity for 4 s, in the body frame, and 2 s more",
              "STATUS_COMMAND_TIMED_OUT", Basis.MEASURED),
    _answered("trajectory_arrives", "RobotCommandFeedback", "half a metre ahead", "STATUS_STOPPED"),
    _answered("commands_have_numbers", "RobotCommand: robot_command_id", "several commands", "a number each"),
    _answered("power_goes", "RobotCommand: safe_power_off", "a sit, motors off", SAT_DOWN),
)
# fmt: on
