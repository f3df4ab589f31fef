"""The one motion of the suite: power on, stand, walk in a turn, walk to a goal, sit, power off, recorded throughout."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bosdyn.api import lease_pb2, robot_command_service_pb2_grpc
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.power import CALL_ERRORS, cut_power, has_power, held, joint_request, send, wait_for
from fake_robot.conformance.recording import Recorder, Recording
from fake_robot.conformance.server import FEATURE, Made, OpenError, Server, enum_name, status_of
from spot_model.robot.facts import N_JOINTS, STAND_KD_NM_S_PER_RAD, STAND_KP_NM_PER_RAD, per_joint
from spot_model.robot.state import Array

SETTLING, STANDING, WALKING, STOPPED, GOING, OFF = "settling", "standing", "walking", "stopped", "going", "off"
HOLDING = "held by joint control"
PUSH_NM = per_joint(0.0, 0.0, 6.0)
"""Added to the knees' loads: a fiftieth of a radian by the stand's own stiffness, and twice what a load is wrong by."""
STEP_TIMEOUT_S = 20.0
VELOCITY_M_S_RAD_S = (0.3, 0.15, 0.5)
"""Forward, to the left, turning left: slow, and each sign shows; it turns so far that no frame stays aligned."""
WALK_S, STARTING_S, ENDING_S = 4.0, 1.0, 2.0
WAY_M = 0.5
SETTLING_S, STANDING_S = 1.0, 1.0
_RETAIN_S = 1.0


class _EndedError(Exception):
    """The robot got no further; the message says why."""


@dataclass
class Session:
    """What was recorded in each part of the motion, and what was answered."""

    pieces: dict[str, Recording] = field(default_factory=dict)
    told: dict[str, str] = field(default_factory=dict)
    command_ids: list[int] = field(default_factory=list)
    held_rad: Array = field(default_factory=lambda: np.zeros(N_JOINTS))
    """The set-points of joint control."""
    ended_by: str = ""

    def keep(self, recorder: Recorder, start: tuple[int, int], part: str) -> None:
        """Keep what came since a mark as a part of the motion."""
        self.pieces[part] = recorder.since(start, part)

    def piece(self, name: str) -> Recording:
        """A part of the recording. Raises OpenError where the robot did not get that far."""
        return self._got(self.pieces, name)

    def answer(self, name: str) -> str:
        """An answer. Raises OpenError where the robot did not get that far."""
        return self._got(self.told, name)

    def _got(self, parts: Mapping[str, Made], name: str) -> Made:
        if name not in parts:
            raise OpenError(f"the robot did not get that far: {self.ended_by}")
        return parts[name]


def drive(server: Server) -> Session:
    """Do it; at the end, whatever happened, the robot sits down and its motors lose power.

    Raises:
        OpenError: The robot is e-stopped, has power already, or somebody holds the lease.
    """
    status = server.ask("estop", "GetEstopSystemStatus").status
    if enum_name(status, "stop_level") != "ESTOP_LEVEL_NONE":
        raise OpenError(f"the e-stop is pressed: {status.stop_level_details or 'no reason is told'}")
    if has_power(server.state()):
        raise OpenError("the motors are on already")
    session = Session()
    with held(server) as lease, _retained(server, lease), Recorder(server) as recorder:
        try:
            _power_on(server, lease, session)
            _stand(server, lease, session, recorder)
            _walk(server, lease, session, recorder)
            _go(server, lease, session, recorder)
            _hold(server, lease, session, recorder)
        except (_EndedError, *CALL_ERRORS) as error:
            session.ended_by = str(error) or type(error).__name__
        finally:
            session.told["power_goes"] = cut_power(server, lease)
        with contextlib.suppress(*CALL_ERRORS):
            start = recorder.mark()
            time.sleep(0.5)
            session.keep(recorder, start, OFF)
    return session


def _power_on(server: Server, lease: lease_pb2.Lease, session: Session) -> None:
    answer = server.ask("power", "PowerCommand", lease=lease, request="REQUEST_ON_MOTORS")
    told = [status_of(answer)]

    def is_over() -> bool:
        if told[-1] == "STATUS_IN_PROGRESS":
            feedback = server.ask("power", "PowerCommandFeedback", power_command_id=answer.power_command_id)
            told.append(status_of(feedback))
        return told[-1] != "STATUS_IN_PROGRESS"

    wait_for(is_over, STEP_TIMEOUT_S)
    session.told["power_comes"] = told[-1]
    if told[-1] != "STATUS_SUCCESS":
        raise _EndedError(f"power on came to {told[-1]}")


def _stand(server: Server, lease: lease_pb2.Lease, session: Session, recorder: Recorder) -> None:
    command_id = _begin(server, lease, session, "stand", RobotCommandBuilder.synchro_stand_command())

    def is_standing() -> bool:
        told = _feedback(server, command_id).stand_feedback
        return bool(told.status == told.STATUS_IS_STANDING)

    if not wait_for(is_standing, STEP_TIMEOUT_S):
        session.told["stand_ends"] = f"not said within {STEP_TIMEOUT_S:g} s"
        raise _EndedError("it did not say that it stands")
    session.told["stand_ends"] = "standing"
    start = recorder.mark()
    time.sleep(SETTLING_S)
    session.keep(recorder, start, SETTLING)
    start = recorder.mark()
    time.sleep(STANDING_S)
    session.keep(recorder, start, STANDING)


def _walk(server: Server, lease: lease_pb2.Lease, session: Session, recorder: Recorder) -> None:
    command = RobotCommandBuilder.synchro_velocity_command(*VELOCITY_M_S_RAD_S)
    command_id = _begin(server, lease, session, "velocity", command, end_s=WALK_S)
    end_s = time.monotonic() + WALK_S
    time.sleep(STARTING_S)
    start = recorder.mark()
    time.sleep(max(0.0, end_s - time.monotonic()))
    session.keep(recorder, start, WALKING)
    seen = [""]

    def is_over() -> bool:
        seen[0] = enum_name(_feedback(server, command_id), "status")
        return seen[0] == "STATUS_COMMAND_TIMED_OUT"

    wait_for(is_over, ENDING_S)
    session.told["velocity_times_out"] = seen[0]
    time.sleep(max(0.0, end_s + ENDING_S - time.monotonic()))
    start = recorder.mark()
    time.sleep(0.5 * STANDING_S)
    session.keep(recorder, start, STOPPED)


def _go(server: Server, lease: lease_pb2.Lease, session: Session, recorder: Recorder) -> None:
    goal = SE2Pose(WAY_M, 0.0, 0.0).to_proto()
    command = RobotCommandBuilder.synchro_se2_trajectory_command(goal, "body")
    start = recorder.mark()
    command_id = _begin(server, lease, session, "trajectory", command, end_s=STEP_TIMEOUT_S)

    def has_stopped() -> bool:
        told = _feedback(server, command_id).se2_trajectory_feedback
        return bool(told.status == told.STATUS_STOPPED)

    is_there = wait_for(has_stopped, STEP_TIMEOUT_S)
    session.told["trajectory_arrives"] = "stopped" if is_there else f"not within {STEP_TIMEOUT_S:g} s"
    session.keep(recorder, start, GOING)
    ids = session.command_ids
    has_three = len(set(ids) - {0}) == len(ids)
    session.told["commands_have_numbers"] = "three numbers" if has_three else f"numbers {ids}"


def _hold(server: Server, lease: lease_pb2.Lease, session: Session, recorder: Recorder) -> None:
    """Hold the stance by joint control, the knees with a load besides, and stand as before."""
    if not server.ask("license", "GetFeatureEnabled", feature_codes=[FEATURE]).feature_enabled[FEATURE]:
        return
    session.held_rad = np.array(recorder.states[-1].joint_states.position[:N_JOINTS])
    is_over = threading.Event()

    def requests() -> Iterator[Any]:
        for key in itertools.count(1):
            yield joint_request(server, session.held_rad, STAND_KP_NM_PER_RAD, STAND_KD_NM_S_PER_RAD, PUSH_NM, key=key)
            if is_over.wait(0.02):
                return

    stub = robot_command_service_pb2_grpc.RobotCommandStreamingServiceStub(server.channel("robot-command-streaming"))
    call = stub.JointControlStream.future(requests(), timeout=STEP_TIMEOUT_S)
    try:
        _begin(server, lease, session, "joint control", RobotCommandBuilder.joint_command())
        time.sleep(SETTLING_S)
        start = recorder.mark()
        time.sleep(STANDING_S)
        session.keep(recorder, start, HOLDING)
        _begin(server, lease, session, "stand", RobotCommandBuilder.synchro_stand_command())
    finally:
        is_over.set()
        call.cancel()


def _begin(
    server: Server, lease: lease_pb2.Lease, session: Session, name: str, command: Any, *, end_s: float | None = None
) -> int:
    answer = send(server, lease, command, end_s=end_s)
    if status_of(answer) != "STATUS_OK":
        raise _EndedError(f"the {name} was answered by {status_of(answer)}")
    session.command_ids.append(answer.robot_command_id)
    return int(answer.robot_command_id)


def _feedback(server: Server, command_id: int) -> Any:
    answer = server.ask("robot-command", "RobotCommandFeedback", robot_command_id=command_id)
    return answer.feedback.synchronized_feedback.mobility_command_feedback


@contextlib.contextmanager
def _retained(server: Server, lease: lease_pb2.Lease) -> Iterator[None]:
    """Keep the lease from getting stale for as long as the block runs."""
    is_over = threading.Event()

    def retain() -> None:
        while not is_over.wait(_RETAIN_S):
            with contextlib.suppress(*CALL_ERRORS):
                server.ask("lease", "RetainLease", lease=lease)

    thread = threading.Thread(target=retain, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
