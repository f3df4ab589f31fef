"""The one motion of the suite, recorded throughout: stand, lean, walk in a turn and to a goal, small steps, sit.

Where an answer says that the robot got no further, its state is the second witness; and a part that fails leaves the
others their turn.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bosdyn.api import lease_pb2, robot_command_service_pb2_grpc, robot_state_pb2
from bosdyn.client.math_helpers import SE2Pose
from bosdyn.client.robot_command import RobotCommandBuilder
from bosdyn.geometry import EulerZXY

from fake_robot.conformance.power import (
    CALL_ERRORS,
    cut_power,
    has_power,
    held,
    joint_request,
    require_off,
    send,
    wait_for,
)
from fake_robot.conformance.recording import RecordedPart, Recorder
from fake_robot.conformance.server import FEATURE, Made, OpenError, Server, enum_name, status_of
from spot_model.robot.facts import N_JOINTS, STAND_KD_NM_S_PER_RAD, STAND_KP_NM_PER_RAD, Array, per_joint

SETTLING, STANDING, WALKING, STOPPED, GOING, OFF = "settling", "standing", "walking", "stopped", "going", "off"
LEANING, UPRIGHT, MOVING = "leaning", "upright again", "moving"
HOLDING, EXPIRED = "held by joint control", "after its last command ended"
PUSH_NM = per_joint(0.0, 0.0, 6.0)
"""Added to the knees' loads: a fiftieth of a radian by the stand's own stiffness, and twice what a load is wrong by."""
LEAN_RAD = (0.12, 0.15, 0.2)
"""Roll, pitch and yaw of the body over its feet: a wrong sign or frame of gravity makes 2 m/s² and more."""
_STEP_NM = np.array([[7.0], [5.0], [4.0]])
"""Steps of positions, velocities and loads: several times a joint's friction, less than motors have to spare."""
_AGAINST = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]]).reshape(N_JOINTS)
"""Signs by which the legs work against each other, so that the feet stay, the body rests and the errors last."""
SLOT_MESSAGES = 5
_STEPPING_S = 3.2
"""Four times all eight combinations of the three steps."""
STEP_TIMEOUT_S, _STREAM_S = 20.0, 30.0
VELOCITY_M_S_RAD_S = (0.3, 0.15, 0.5)
"""Forward, to the left, turning left: slow, and each sign shows; it turns so far that no frame stays aligned."""
WALK_S, STARTING_S, ENDING_S = 4.0, 1.0, 2.0
WAY_M = 0.5
SETTLING_S, STANDING_S = 1.0, 1.0
_STANDING = robot_state_pb2.BehaviorState.STATE_STANDING


WHILE_STANDING: dict[str, Callable[[Server, lease_pb2.Lease], str]] = {}
"""What is asked of the robot while it stands, by the name under which the answer is told."""


class _EndedError(Exception):
    """The robot got no further; the message says why."""


@dataclass
class MotionRecord:
    """What was recorded in each part of the motion, and what was answered."""

    pieces: dict[str, RecordedPart] = field(default_factory=dict)
    told: dict[str, str] = field(default_factory=dict)
    command_ids: list[int] = field(default_factory=list)
    asked: dict[int, Array] = field(default_factory=dict)
    """Positions, velocities and loads that joint control asked for, shape (3, 12), by the command's key."""
    ended_by: str = ""

    def got(self, parts: Mapping[str, Made], name: str) -> Made:
        """One of the pieces, or of the answers. Raises OpenError where the robot did not get that far."""
        if name not in parts:
            raise OpenError(f"the robot did not get that far: {self.ended_by}")
        return parts[name]


def drive(server: Server) -> MotionRecord:
    """Do it; at the end, whatever happened, the robot sits down and its motors lose power. Raises OpenError."""
    status = server.ask("estop", "GetEstopSystemStatus").status
    is_pressed = any(estop.state != estop.STATE_NOT_ESTOPPED for estop in server.state().estop_states)
    if is_pressed and enum_name(status, "stop_level") != "ESTOP_LEVEL_NONE":
        raise OpenError(f"the e-stop is pressed: {status.stop_level_details or 'no reason is told'}")
    require_off(server)
    session = MotionRecord()
    with held(server) as lease, Recorder(server, lease) as recorder:
        driver = _Driver(server, lease, recorder, session)
        try:
            if driver.attempt(driver.power_on) and driver.attempt(driver.stand):
                for part in (driver.lean, driver.ask_refused, driver.walk, driver.go, driver.hold):
                    driver.attempt(part)
        finally:
            session.told["power_goes"] = cut_power(server, lease)
        with contextlib.suppress(*CALL_ERRORS):
            session.pieces[MOVING] = recorder.since((0, 0), MOVING)
            driver.record(OFF, 0.5)
    ids = session.command_ids
    has_numbers = len(ids) > 1 and len(set(ids) - {0}) == len(ids)
    session.told["commands_have_numbers"] = "a number each" if has_numbers else f"numbers {ids}"
    return session


@dataclass
class _Driver:
    server: Server
    lease: lease_pb2.Lease
    recorder: Recorder
    session: MotionRecord

    def attempt(self, part: Callable[[], object]) -> bool:
        """Do a part of the motion; whether it came to its end."""
        try:
            part()
        except Exception as error:  # noqa: BLE001 - a stranger's answers must not keep the others from their turn
            self.session.ended_by += f"{part.__name__}: {str(error) or type(error).__name__}; "
            return False
        return True

    def power_on(self) -> None:
        answer = self.server.ask("power", "PowerCommand", lease=self.lease, request="REQUEST_ON_MOTORS")
        told, wanted = status_of(answer), {"power_command_id": answer.power_command_id}
        if told == "STATUS_IN_PROGRESS":

            def ask() -> str:
                return status_of(self.server.ask("power", "PowerCommandFeedback", **wanted))

            told = wait_for(ask, lambda seen: seen != "STATUS_IN_PROGRESS", STEP_TIMEOUT_S)
        self._tell("power_comes", told, "STATUS_SUCCESS", has_power)

    def stand(self) -> None:
        told = self._follow(RobotCommandBuilder.synchro_stand_command(), "stand_feedback.status", "STATUS_IS_STANDING")
        self._tell("stand_ends", told, "STATUS_IS_STANDING", lambda s: s.behavior_state.state == _STANDING)
        start = self.recorder.mark()
        time.sleep(SETTLING_S)
        self.record(STANDING, STANDING_S)
        self.session.pieces[SETTLING] = self.recorder.since(start, SETTLING)

    def lean(self) -> None:
        """Turn the body over its feet, and stand as before."""
        roll, pitch, yaw = LEAN_RAD
        for part, pose in ((LEANING, EulerZXY(yaw, roll, pitch)), (UPRIGHT, EulerZXY())):
            number = self._begin(RobotCommandBuilder.synchro_stand_command(footprint_R_body=pose))
            self._wait(number, "stand_feedback.status", "STATUS_IS_STANDING", 2.0 * SETTLING_S)
            time.sleep(0.5 * SETTLING_S)
            self.record(part, 0.5 * STANDING_S)

    def ask_refused(self) -> None:
        """Send what a robot must refuse, to one that has power; it moves nothing if it is taken."""
        for name, ask in WHILE_STANDING.items():
            self.session.told[name] = ask(self.server, self.lease)

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

    def hold(self) -> None:
        """Hold the stance by joint control with small steps about it, then let the last command end."""
        if "license" not in self.server.listed:
            return
        told = self.server.ask("license", "GetFeatureEnabled", feature_codes=[FEATURE]).feature_enabled
        if not told.get(FEATURE, True):
            return
        at_rad = self._position_rad()
        is_silent, is_over = threading.Event(), threading.Event()

        def requests() -> Iterator[Any]:
            for key in itertools.count(1):
                if is_silent.is_set():
                    break
                setpoints = self.session.asked[key] = _stepped(at_rad, key)
                yield joint_request(self.server, setpoints, STAND_KP_NM_PER_RAD, STAND_KD_NM_S_PER_RAD, key=key)
                is_silent.wait(0.02)
            is_over.wait()

        channel = self.server.channel("robot-command-streaming")
        stub = robot_command_service_pb2_grpc.RobotCommandStreamingServiceStub(channel)
        call = stub.JointControlStream.future(requests(), timeout=_STREAM_S)
        try:
            self._begin(RobotCommandBuilder.joint_command())
            time.sleep(0.5 * SETTLING_S)
            self.record(HOLDING, _STEPPING_S)
            is_silent.set()
            time.sleep(ENDING_S)
            self.record(EXPIRED, 0.5 * STANDING_S)
            if np.abs(self._position_rad() - at_rad).max() < 0.2:
                self._begin(RobotCommandBuilder.synchro_stand_command())
        finally:
            is_silent.set()
            is_over.set()
            call.cancel()

    def _position_rad(self) -> Array:
        return np.array(self.recorder.states[-1].joint_states.position[:N_JOINTS])

    def record(self, part: str, duration_s: float) -> None:
        """Keep what comes for a while as a part of the motion."""
        start = self.recorder.mark()
        time.sleep(max(0.0, duration_s))
        self.session.pieces[part] = self.recorder.since(start, part)

    def _tell(self, name: str, told: str, wanted: str, shows: Callable[[Any], bool]) -> None:
        self.session.told[name] = told
        if told != wanted and not shows(self.server.state()):
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


def _stepped(at_rad: Array, key: int) -> Array:
    """Set-points of a command: each step is up or down by one digit of the number of the slot."""
    slot = key // SLOT_MESSAGES
    steps_nm = _AGAINST * [[1 - 2 * (slot >> digit & 1)] for digit in (2, 1, 0)] * _STEP_NM
    ones = np.ones(N_JOINTS)
    gains = np.array([STAND_KP_NM_PER_RAD, STAND_KD_NM_S_PER_RAD, ones])
    return np.asarray(np.array([at_rad, 0.0 * ones, PUSH_NM]) + steps_nm / gains)
