"""Checks of the joint-control stream, with the motors off: what a robot refuses in one message."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from bosdyn.api import robot_command_service_pb2_grpc

from fake_robot.conformance.check import Basis, Check, Needs, check
from fake_robot.conformance.power import joint_request, unpowered
from fake_robot.conformance.recording import NAMES, record_rest
from fake_robot.conformance.server import Server, SkippedError, status_of
from fake_robot.conformance.session import HOLDING, PUSH_NM, Session, drive
from spot_model.robot.facts import N_JOINTS, STAND_KD_NM_S_PER_RAD, STAND_KP_NM_PER_RAD

_PROTO = "robot_command.proto, basic_command.proto: JointCommand"
_ELEVEN, _WAIT = "eleven values", "joint_control.activation_wait_s"
_HOLD = "the stance, and a push by the knees"
_LOAD_NM = 8.0
"""Loads are measured to some N·m; a wrong sign or stiffness makes more than that."""
_STREAM_TIMEOUT_S = 30.0


def _request(server: Server, key: int = 1) -> Any:
    """A message that holds every joint where it is, with weak gains."""
    position_rad = server.once(record_rest).streamed.position_rad[-1]
    ones = np.ones(N_JOINTS)
    return joint_request(server, position_rad, ones, 0.1 * ones, 0.0 * ones, key=key)


def _stream(server: Server, requests: Iterable[Any]) -> str:
    """The verdict of a stream of these messages, without power; one that is refused says why."""
    with unpowered(server):
        stub = robot_command_service_pb2_grpc.RobotCommandStreamingServiceStub(
            server.channel("robot-command-streaming")
        )
        answer = stub.JointControlStream(iter(requests), timeout=_STREAM_TIMEOUT_S)
    seen = status_of(answer)
    return seen if answer.message or seen == "STATUS_OK" else f"{seen}, without a word"


def _spoilt(name: str, field: str, sends: str, spoil: Callable[[Any], object], *expects: str, **more: Any) -> Check:
    """One message in which a field is not as it must be."""

    def probe(server: Server) -> str:
        request = _request(server)
        spoil(request.joint_command if field != "contact_advice" else request)
        return _stream(server, [request])

    basis, switch = more.get("basis", Basis.DOCUMENTED), more.get("switch", "")
    expects = expects or ("STATUS_INVALID_REQUEST",)
    return Check(name, f"JointControlStream: {field}", sends, expects, basis, _PROTO, Needs.LEASE, switch, probe)


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


@check("JointControlStream", "no joint control", "STATUS_INACTIVE", source=_PROTO, needs=Needs.LEASE, switch=_WAIT)
def stream_while_inactive(server: Server) -> str:
    """Commands to a robot that nobody has put into joint control, for as long as it lets them come."""
    return _stream(server, _many(server))


def _many(server: Server) -> Iterator[Any]:
    """Commands at 50 Hz until the robot ends the stream."""
    for key in range(1, round(_STREAM_TIMEOUT_S * 50)):
        yield _request(server, key)
        time.sleep(0.02)


@check("JointControlStream", _HOLD, "the servo law, and the command's key", source=_PROTO, needs=Needs.MOTION)
def servo_law(server: Server) -> str:
    """Loads are stiffness times error, damping and the load asked for; the state tells the last command."""
    session: Session = server.once(drive)
    if not session.ended_by and HOLDING not in session.pieces:
        raise SkippedError("joint control is not licensed")
    recording = session.got(session.pieces, HOLDING)
    motion = recording.streamed
    wanted_nm = STAND_KP_NM_PER_RAD * (session.held_rad - motion.position_rad) + PUSH_NM
    wanted_nm -= STAND_KD_NM_S_PER_RAD * motion.velocity_rad_s
    off_nm = np.median(np.abs(motion.load_nm - wanted_nm), axis=0)
    if off_nm.max() > _LOAD_NM:
        return f"{NAMES[int(off_nm.argmax())]}: the load is {off_nm.max():.1f} N·m off"
    keys = [state.last_command.user_command_key for state in recording.states]
    return "the servo law, and the command's key" if 0 < keys[0] < keys[-1] else f"keys {keys[0]} to {keys[-1]}"
