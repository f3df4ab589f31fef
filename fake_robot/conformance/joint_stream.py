"""Checks of the joint-control stream, with the motors off: what a robot refuses in one message."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from bosdyn.api import robot_command_pb2, robot_command_service_pb2_grpc

from fake_robot.conformance.check import Basis, Check, Needs, check
from fake_robot.conformance.power import unpowered
from fake_robot.conformance.recording import record_rest
from fake_robot.conformance.server import Server, header, status_of

_PROTO = "robot_command.proto"
_JOINT = "basic_command.proto: JointCommand"
_N = 12
_STREAM_TIMEOUT_S = 30.0
Request = robot_command_pb2.JointControlStreamRequest


def _request(server: Server, key: int = 1, *, ahead_s: float = 0.1) -> Any:
    """A message that holds every joint where it is, with weak gains."""
    request = Request(header=header())
    command = request.joint_command
    command.end_time.CopyFrom(server.robot_stamp(ahead_s))
    command.position.extend(server.once(record_rest).streamed.position_rad[-1].tolist())
    command.velocity.extend([0.0] * _N)
    command.load.extend([0.0] * _N)
    command.gains.k_q_p.extend([1.0] * _N)
    command.gains.k_qd_p.extend([0.1] * _N)
    command.user_command_key = key
    return request


def _stream(server: Server, requests: Iterable[Any]) -> str:
    """The verdict of a stream of these messages, without power; one that is refused says why."""
    with unpowered(server):
        stub = server.stub(robot_command_service_pb2_grpc.RobotCommandStreamingServiceStub, "robot-command-streaming")
        answer = stub.JointControlStream(iter(requests), timeout=_STREAM_TIMEOUT_S)
    seen = status_of(answer)
    return seen if answer.message or seen == "STATUS_OK" else f"{seen}, without a word"


@check(
    "JointControlStream: end_time", "an end time that has passed", "STATUS_EXPIRED", source=_PROTO, needs=Needs.LEASE
)
def stream_expired(server: Server) -> str:
    """A command that ended a second ago."""
    return _stream(server, [_request(server, ahead_s=-1.0)])


@check(
    "JointControlStream: end_time",
    "an end time hours ahead",
    "STATUS_TOO_DISTANT",
    source=_PROTO,
    needs=Needs.LEASE,
    switch="joint_control.max_end_time_ahead_s",
)
def stream_too_distant(server: Server) -> str:
    """A command that would hold for hours."""
    return _stream(server, [_request(server, ahead_s=1e5)])


@check("JointControlStream: end_time", "no end time", "refused", source=_JOINT, needs=Needs.LEASE)
def stream_without_end(server: Server) -> str:
    """A command for ever; the proto does not name the status."""
    request = _request(server)
    request.joint_command.ClearField("end_time")
    seen = _stream(server, [request])
    return "refused" if seen in {"STATUS_EXPIRED", "STATUS_INVALID_REQUEST"} else seen


def _spoilt(name: str, field: str, sends: str, spoil: Callable[[Any], None], basis: Basis = Basis.DOCUMENTED) -> Check:
    """One message in which a field is not as it must be."""

    def probe(server: Server) -> str:
        request = _request(server)
        spoil(request)
        return _stream(server, [request])

    expects = ("STATUS_INVALID_REQUEST",)
    return Check(name, f"JointControlStream: {field}", sends, expects, basis, _JOINT, Needs.LEASE, "", probe)


_ELEVEN = "eleven values"
SPOILT = (
    _spoilt("stream_of_eleven_positions", "position", _ELEVEN, lambda r: r.joint_command.position.pop()),
    _spoilt("stream_of_eleven_velocities", "velocity", _ELEVEN, lambda r: r.joint_command.velocity.pop()),
    _spoilt("stream_of_eleven_loads", "load", _ELEVEN, lambda r: r.joint_command.load.pop()),
    _spoilt(
        "stream_without_gains", "gains", "none in the first message", lambda r: r.joint_command.ClearField("gains")
    ),
    _spoilt("stream_of_partial_gains", "gains.k_q_p", _ELEVEN, lambda r: r.joint_command.gains.k_q_p.pop()),
    _spoilt(
        "stream_of_negative_gains",
        "gains.k_qd_p",
        "a negative gain",
        lambda r: r.joint_command.gains.k_qd_p.__setitem__(0, -1.0),
        Basis.GUESS,
    ),
    _spoilt(
        "stream_of_nan",
        "position",
        "a value that is NaN",
        lambda r: r.joint_command.position.__setitem__(0, float("nan")),
        Basis.GUESS,
    ),
    _spoilt(
        "stream_of_negative_limit",
        "velocity_safety_limit",
        "a negative limit",
        lambda r: setattr(r.joint_command.velocity_safety_limit, "value", -1.0),
    ),
    _spoilt(
        "stream_of_three_contacts",
        "contact_advice",
        "three values",
        lambda r: r.contact_advice.contact_advice.extend([1, 1, 1]),
    ),
)


@check(
    "JointControlStream",
    "a valid stream, the robot not in joint control",
    "STATUS_INACTIVE",
    source=_PROTO,
    needs=Needs.LEASE,
    switch="joint_control.activation_wait_s",
)
def stream_while_inactive(server: Server) -> str:
    """Good commands to a robot that nobody has put into joint control, for as long as it lets them come."""
    return _stream(server, _many(server))


def _many(server: Server) -> Iterator[Any]:
    """Commands at 50 Hz until the robot ends the stream."""
    for key in range(1, round(_STREAM_TIMEOUT_S * 50)):
        yield _request(server, key)
        time.sleep(0.02)
