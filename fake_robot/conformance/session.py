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

from fake_robot.conformance.power import CALL_ERRORS, cut_power, held, joint_request, require_off, send, wait_for
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

    def got(self, parts: Mapping[str, Made], name: str) -> Made:
        """One of the pieces, or of the answers. Raises OpenError where the robot did not get that far."""
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
    require_off(server)
    session = Session()
    with held(server) as lease, Recorder(server, lease) as recorder:
        driver = _Driver(server, lease, recorder, session)
        try:
            for step in (driver.power_on, driver.stand, driver.walk, driver.go, driver.hold):
                step()
        except (_EndedError, *CALL_ERRORS) as error:
            session.ended_by = str(error) or type(error).__name__
        finally:
            session.told["power_goes"] = cut_power(server, lease)
        with contextlib.suppress(*CALL_ERRORS):
            driver.record(OFF, 0.5)
    return session


@dataclass
class _Driver:
    server: Server
    lease: lease_pb2.Lease
    recorder: Recorder
    session: Session

    def power_on(self) -> None:
        answer = self.server.ask("power", "PowerCommand", lease=self.lease, request="REQUEST_ON_MOTORS")
        told, wanted = status_of(answer), {"power_command_id": answer.power_command_id}
        if told == "STATUS_IN_PROGRESS":

            def ask() -> str:
                return status_of(self.server.ask("power", "PowerCommandFeedback", **wanted))

            told = wait_for(ask, lambda seen: seen != "STATUS_IN_PROGRESS", STEP_TIMEOUT_S)
        self._tell("power_comes", told, "STATUS_SUCCESS")

    def stand(self) -> None:
        told = self._follow(RobotCommandBuilder.synchro_stand_command(), "stand_feedback.status", "STATUS_IS_STANDING")
        self._tell("stand_ends", told, "STATUS_IS_STANDING")
        start = self.recorder.mark()
        time.sleep(SETTLING_S)
        self.record(STANDING, STANDING_S)
        self.session.pieces[SETTLING] = self.recorder.since(start, SETTLING)

    def walk(self) -> None:
        command_id = self._begin(RobotCommandBuilder.synchro_velocity_command(*VELOCITY_M_S_RAD_S), WALK_S)
        end_s = time.monotonic() + WALK_S
        time.sleep(STARTING_S)
        self.record(WALKING, end_s - time.monotonic())
        told = self._wait(command_id, "status", "STATUS_COMMAND_TIMED_OUT", ENDING_S)
        self.session.told["velocity_times_out"] = told
        time.sleep(max(0.0, end_s + ENDING_S - time.monotonic()))
        self.record(STOPPED, 0.5 * STANDING_S)

    def go(self) -> None:
        goal = RobotCommandBuilder.synchro_se2_trajectory_command(SE2Pose(WAY_M, 0.0, 0.0).to_proto(), "body")
        start = self.recorder.mark()
        told = self._follow(goal, "se2_trajectory_feedback.status", "STATUS_STOPPED", end_s=STEP_TIMEOUT_S)
        self.session.told["trajectory_arrives"] = told
        self.session.pieces[GOING] = self.recorder.since(start, GOING)
        ids = self.session.command_ids
        has_three = len(set(ids) - {0}) == len(ids)
        self.session.told["commands_have_numbers"] = "three numbers" if has_three else f"numbers {ids}"

    def hold(self) -> None:
        """Hold the stance by joint control, the knees with a load besides, and stand as before."""
        if "license" not in self.server.listed:
            return
        if not self.server.ask("license", "GetFeatureEnabled", feature_codes=[FEATURE]).feature_enabled[FEATURE]:
            return
        at_rad = np.array(self.recorder.states[-1].joint_states.position[:N_JOINTS])
        self.session.held_rad = at_rad
        is_over = threading.Event()

        def requests() -> Iterator[Any]:
            for key in itertools.count(1):
                yield joint_request(self.server, at_rad, STAND_KP_NM_PER_RAD, STAND_KD_NM_S_PER_RAD, PUSH_NM, key=key)
                if is_over.wait(0.02):
                    return

        channel = self.server.channel("robot-command-streaming")
        stub = robot_command_service_pb2_grpc.RobotCommandStreamingServiceStub(channel)
        call = stub.JointControlStream.future(requests(), timeout=STEP_TIMEOUT_S)
        try:
            self._begin(RobotCommandBuilder.joint_command())
            time.sleep(SETTLING_S)
            self.record(HOLDING, STANDING_S)
            self._begin(RobotCommandBuilder.synchro_stand_command())
        finally:
            is_over.set()
            call.cancel()

    def record(self, part: str, duration_s: float) -> None:
        """Keep what comes for a while as a part of the motion."""
        start = self.recorder.mark()
        time.sleep(max(0.0, duration_s))
        self.session.pieces[part] = self.recorder.since(start, part)

    def _tell(self, name: str, told: str, wanted: str) -> None:
        self.session.told[name] = told
        if told != wanted:
            raise _EndedError(f"{name}: {told}")

    def _begin(self, command: Any, end_s: float | None = None) -> int:
        def give() -> Any:
            return send(self.server, self.lease, command, end_s=end_s)

        # Motors that have just got power may not be ready yet.
        answer = wait_for(give, lambda seen: status_of(seen) != "STATUS_NOT_POWERED_ON", SETTLING_S)
        if status_of(answer) != "STATUS_OK":
            raise _EndedError(f"a command was answered by {status_of(answer)}")
        self.session.command_ids.append(answer.robot_command_id)
        return int(answer.robot_command_id)

    def _follow(self, command: Any, field: str, wanted: str, end_s: float | None = None) -> str:
        return self._wait(self._begin(command, end_s), field, wanted, STEP_TIMEOUT_S)

    def _wait(self, command_id: int, field: str, wanted: str, timeout_s: float) -> str:
        def ask() -> str:
            answer = self.server.ask("robot-command", "RobotCommandFeedback", robot_command_id=command_id)
            return enum_name(answer.feedback.synchronized_feedback.mobility_command_feedback, field)

        return wait_for(ask, lambda seen: seen == wanted, timeout_s)
