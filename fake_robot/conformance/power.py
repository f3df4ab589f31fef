"""The motors' power: who may have it, how we know, and how it is taken away."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
from bosdyn.api import lease_pb2, robot_command_pb2, robot_state_pb2
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.recording import ReportedMotion, record_rest
from fake_robot.conformance.server import (
    CLIENT_NAME,
    Made,
    OpenError,
    Server,
    SkippedError,
    enum_name,
    header,
    status_of,
)
from spot_model.robot.arm import ARM_KD_NM_S_PER_RAD, ARM_KP_NM_PER_RAD
from spot_model.robot.facts import N_JOINTS, Array

POLL_S = 0.1
SAT_DOWN = "it sat down and is off again"
CONTROLLED_OFF_S = 15.0
"""For a robot to sit down and switch its motors off."""
_UNPOWERED = "STATUS_NOT_POWERED_ON"
_CARRIES = 0.3
"""Share of its weight that the legs of a robot which stands carry at least; those of one on its belly carry nothing."""
CALL_ERRORS = (grpc.RpcError, OpenError, SkippedError)
"""What a call may raise."""


def has_power(state: robot_state_pb2.RobotState) -> bool:
    """Whether the motors are reported to have power, or to be about to."""
    power = state.power_state
    return power.motor_power_state in {power.MOTOR_POWER_STATE_ON, power.MOTOR_POWER_STATE_POWERING_ON}


def is_off(state: robot_state_pb2.RobotState) -> bool:
    """Whether the motors are reported to have no power; a state that is not known is none of both."""
    return bool(state.power_state.motor_power_state == state.power_state.MOTOR_POWER_STATE_OFF)


def require_off(server: Server) -> None:
    """Raise OpenError unless the motors have no power, as :func:`unpowered` knows it."""
    if not is_off(server.state()):
        with unpowered(server):
            return


def send(
    server: Server, lease: lease_pb2.Lease, command: Any, *, clock: str | None = None, end_s: float | None = 5.0
) -> robot_command_pb2.RobotCommandResponse:
    """Send a command; a timed one ends ``end_s`` from now, or bears no end time."""
    sent = robot_command_pb2.RobotCommand()
    sent.CopyFrom(command)
    mobility = sent.synchronized_command.mobility_command
    field = mobility.WhichOneof("command")
    if end_s is not None and field in {"se2_velocity_request", "se2_trajectory_request", "stance_request"}:
        getattr(mobility, field).end_time.CopyFrom(server.robot_stamp(end_s))
    identifier = server.sync.clock_identifier if clock is None else clock
    return server.ask("robot-command", "RobotCommand", lease=lease, command=sent, clock_identifier=identifier)


def joint_request(server: Server, setpoints: Array, kp: Array, kd: Array, *, key: int = 1) -> Any:
    """A message of joint control for half a second: positions, velocities and loads, shape (3, 12).

    An arm's joints are held where they were at rest, by the vendor's gains.
    """
    request = robot_command_pb2.JointControlStreamRequest(header=header())
    command = request.joint_command
    command.end_time.CopyFrom(server.robot_stamp(0.5))
    parts = (command.position, command.velocity, command.load, command.gains.k_q_p, command.gains.k_qd_p)
    arm_rad = server.once(record_rest).states[-1].joint_states.position[N_JOINTS:]
    zeros = [0.0] * len(arm_rad)
    gains = [of.tolist() if arm_rad else [] for of in (ARM_KP_NM_PER_RAD, ARM_KD_NM_S_PER_RAD)]
    for field, values, arm in zip(parts, (*setpoints, kp, kd), (arm_rad, zeros, zeros, *gains), strict=True):
        field.extend(values.tolist() + arm)
    command.user_command_key = key
    return request


@contextlib.contextmanager
def held(server: Server, resource: str = "body") -> Iterator[lease_pb2.Lease]:
    """The lease for as long as the block runs; somebody else's is never taken, our own is if its return was not heard.

    Raises:
        OpenError: Somebody holds it.
    """
    answer = server.ask("lease", "AcquireLease", resource=resource)
    if answer.status != answer.STATUS_OK:
        listed = server.ask("lease", "ListLeases").resources
        if (resource, CLIENT_NAME) in {(r.resource, r.lease_owner.client_name) for r in listed}:
            answer = server.ask("lease", "TakeLease", resource=resource)
    if answer.status != answer.STATUS_OK:
        raise OpenError(f"the lease is not to be had: {status_of(answer)}")
    try:
        yield answer.lease
    finally:
        with contextlib.suppress(*CALL_ERRORS):
            server.ask("lease", "ReturnLease", lease=answer.lease)


@contextlib.contextmanager
def unpowered(server: Server) -> Iterator[lease_pb2.Lease]:
    """The lease of a robot without power, by two witnesses: its state, and that it refuses a stop for want of power.

    A stop moves no robot, whatever its power. Where the two contradict each other, what power there may be is taken
    away, and the legs' loads are the second witness.

    Raises:
        OpenError: The motors have power, or may have.
    """
    with held(server) as lease:
        witnesses = {is_off(server.state()), stop(server, lease) == _UNPOWERED}
    if witnesses == {False}:
        raise OpenError("the motors are not off, by the robot's state and by its answer to a stop")
    if witnesses != {True}:
        server.once(_take_power)
    with held(server) as lease:
        yield lease


def _take_power(server: Server) -> None:
    """Take away what power there may be. Raises OpenError if the legs still carry the robot then."""
    cut_power(server)
    loads = wait_for(lambda: record_rest(server).motions, _carry_nothing, CONTROLLED_OFF_S)
    if not _carry_nothing(loads):
        raise OpenError("the motors may have power: the legs carry the robot")


def _carry_nothing(motions: list[ReportedMotion]) -> bool:
    return all(abs(motion.share_of_weight()) < _CARRIES for motion in motions)


def stop(server: Server, lease: lease_pb2.Lease) -> str:
    """The answer to a stop."""
    return status_of(send(server, lease, RobotCommandBuilder.stop_command()))


def wait_for(ask: Callable[[], Made], is_done: Callable[[Made], bool], timeout_s: float) -> Made:
    """Ask until the answer will do, or the time is over; returns the last answer."""
    deadline_s = time.monotonic() + timeout_s
    while not is_done(seen := ask()) and time.monotonic() < deadline_s:
        time.sleep(POLL_S)
    return seen


def cut_power(server: Server, held_lease: lease_pb2.Lease | None = None) -> str:
    """Have the robot sit down and switch its motors off; where it does not, switch them off as they are.

    The lease is acquired unless it is held already. Returns what became of it, in words.
    """

    def has_none() -> bool:
        with contextlib.suppress(*CALL_ERRORS):
            return is_off(server.state())
        return False

    with contextlib.ExitStack() as stack:
        lease = held_lease or lease_pb2.Lease()
        if held_lease is None:
            with contextlib.suppress(*CALL_ERRORS):
                lease = stack.enter_context(held(server))
        with contextlib.suppress(*CALL_ERRORS):
            sent = send(server, lease, RobotCommandBuilder.safe_power_off_command())
            if status_of(sent) == "STATUS_OK" and wait_for(has_none, bool, CONTROLLED_OFF_S):
                return SAT_DOWN
        with contextlib.suppress(*CALL_ERRORS):
            answer = server.ask("power", "PowerCommand", lease=lease, request="REQUEST_OFF_MOTORS")
            if wait_for(has_none, bool, CONTROLLED_OFF_S):
                return "its motors were switched off"
            return f"BY ITS STATE THEY STILL HAVE POWER ({enum_name(answer, 'status')}): press the robot's e-stop"
    return "THEY STILL HAVE POWER: press the robot's e-stop"
