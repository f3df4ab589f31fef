"""However a run ends, power goes off, or every word says that it did not; by hand-made robots, in this process."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bosdyn.api import estop_pb2, power_pb2, robot_command_pb2
from bosdyn.client.estop import IncorrectChallengeResponseError
from bosdyn.client.exceptions import TimedOutError
from bosdyn.client.power import CommandInProgressError
from bosdyn.client.robot_command import NotPoweredOnError

from spot_log import read_run
from spot_log.format.records import EventRecord, Record, RunHeader
from spot_log.write.flight_recorder import FlightRecorder
from spot_log.write.sink import MemorySink
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.policy import Policy
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_runtime.config import HandoverConfig, RobotConfig, RunConfig, for_lock_step
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.base import JointControl, RobotInfo
from spot_runtime.hal.errors import EstopError, HalError, LeaseHeldError, MotionError
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.calls import Calls
from spot_runtime.hal.spot.estop import OwnEstop
from spot_runtime.hal.spot.motions import CUT_S, Helm, Motions
from spot_runtime.host.journal import Console
from spot_runtime.session import run as run_module
from spot_runtime.session.robot_session import ControlEnd, RobotSession
from spot_runtime.session.run import RunRequest, run_once
from spot_runtime.session.signals import OperatorInterrupt, StopSignals
from spot_runtime.session.summary import RunSummary
from spot_runtime.stops import Stop, StopReason
from spot_tools.sources import QUIT, ScriptedSource, TerminalKeys
from tests.spot_runtime.conftest import HandMadeRobot

HANDOVER = HandoverConfig(settle_s=0.3, ramp_in_s=0.1, ramp_out_s=0.1, soft_stop_s=0.0, soft_stop_settle_s=0.0)
CONFIG = for_lock_step(RunConfig(handover=HANDOVER))


def send(number: signal.Signals) -> None:
    """To this thread: its handler has run when this returns."""
    signal.pthread_kill(threading.get_ident(), number)


def refuse(words: str) -> Callable[[], None]:
    def raise_it() -> None:
        raise MotionError(words)

    return raise_it


@dataclass
class Troubled(HandMadeRobot):
    """Something happens in one of its calls: the ``n``-th of a name."""

    troubles: dict[tuple[str, int], Callable[[], None]] = field(default_factory=dict)
    sink: MemorySink = field(default_factory=MemorySink)

    def connect(self) -> RobotInfo:
        info = super().connect()
        self._meet("connect")
        return info

    def stand(self) -> None:
        super().stand()
        self._meet("stand")

    def power_off(self) -> None:
        super().power_off()
        self._meet("power_off")

    def _meet(self, name: str) -> None:
        trouble = self.troubles.get((name, self.calls.count(name)))
        if trouble is not None:
            trouble()

    def drive(self, policy: Policy, path: Path) -> RunSummary:
        request = RunRequest("by hand", policy, ScriptedSource(standing_sequence(0.1)), CONFIG, path / "run.mcap")
        console = Console(io.StringIO())
        try:
            return run_once(request, lambda _: self, lambda *_: self.sink, console)
        finally:
            console.close()

    def said(self) -> list[str]:
        return [event.name for event in self.sink.events]


@dataclass
class Interrupting(MemorySink):
    """A signal comes just as an event is written: amid the answer to whatever the event is about."""

    at: str = ""
    number: signal.Signals = signal.SIGTERM

    def put(self, record: Record) -> None:
        super().put(record)
        if isinstance(record, EventRecord) and record.name == self.at:
            self.at = ""
            send(self.number)


@pytest.mark.parametrize("call", ["connect", "stand"])
@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGHUP, signal.SIGQUIT])
def test_of_two_signals_neither_keeps_the_power_on(
    zero_policy: Policy, tmp_path: Path, call: str, second: signal.Signals
) -> None:
    is_estop = second is signal.SIGQUIT
    sink = Interrupting(at="stop", number=second)
    robot = Troubled(troubles={(call, 1): lambda: send(signal.SIGTERM)}, sink=sink)
    assert robot.drive(zero_policy, tmp_path).outcome == ("operator_estop" if is_estop else "operator_stop")
    assert ("estop" in robot.calls) is is_estop
    assert robot.calls[-2:] == ["power_off", "close"]


def test_a_signal_amid_the_answer_to_an_error_still_powers_off(zero_policy: Policy, tmp_path: Path) -> None:
    robot = Troubled(troubles={("stand", 1): refuse("no")}, sink=Interrupting(at="connection_failed"))
    summary = robot.drive(zero_policy, tmp_path)
    assert (summary.outcome, summary.exit_code) == ("motion_failed", 89)
    assert summary.sentence.startswith("no; then the operator asked to stop")
    assert robot.calls[-2:] == ["power_off", "close"]


def test_a_fault_stays_the_outcome_whatever_signals_follow_it(zero_policy: Policy, tmp_path: Path) -> None:
    for number in (signal.SIGINT, signal.SIGQUIT):
        robot = Troubled(
            mutate=lambda state: [replace(state, odom_from_body_wxyz=np.array([0.9, 0.43588989, 0.0, 0.0]))],
            sink=Interrupting(at="stop", number=number),
            troubles={("power_off", 1): lambda number=number: send(number)},
        )
        summary = robot.drive(zero_policy, tmp_path)
        assert summary.outcome == "tilt", summary.sentence
        assert robot.calls[-1] == "close"


@pytest.mark.parametrize(("wxyz", "stands"), [([0.0, 1.0, 0.0, 0.0], False), ([0.999, 0.04, 0.0, 0.0], True)])
def test_a_robot_that_lies_on_its_back_is_not_asked_to_stand(
    zero_policy: Policy, tmp_path: Path, wxyz: list[float], stands: bool
) -> None:
    attitude = np.array(wxyz) / np.linalg.norm(wxyz)
    robot = Troubled(mutate=lambda state: [replace(state, odom_from_body_wxyz=attitude)])
    summary = robot.drive(zero_policy, tmp_path)
    assert ("stand" in robot.calls) is stands
    assert summary.outcome == ("completed" if stands else "robot_fault"), summary.sentence
    assert robot.calls[-2:] == ["power_off", "close"]
    assert not robot.sent or stands


LIES = np.array([0.0, 1.0, 0.0, 0.0])
"""Upside down."""
ENDS = (
    *(StopReason.COMPLETED, StopReason.OPERATOR_STOP, StopReason.OPERATOR_DAMP, StopReason.OPERATOR_ESTOP),
    *(StopReason.STATE_STALE, StopReason.LEASE_LOST, StopReason.SIGNALS_CONTRADICT, StopReason.POSITION_REFUSED),
    *(StopReason.INTERNAL_ERROR, StopReason.BATTERY_LOW),
)


def session_after(robot: Troubled, end: ControlEnd) -> tuple[RobotSession, list[str]]:
    told: list[str] = []
    with StopSignals() as signals:
        session = RobotSession(signals, lambda _, text: told.append(text))
        session.drive(lambda: robot, lambda _: end)
    assert robot.calls[-2:] == ["power_off", "close"]
    return session, told


@pytest.mark.parametrize("end", ENDS)
def test_a_robot_that_tips_over_as_it_sits_down_fell_whatever_came_first(end: StopReason) -> None:
    robot = Troubled()

    def tip() -> None:
        robot.mutate = lambda state: [replace(state, odom_from_body_wxyz=LIES)]

    robot.troubles = {("power_off", 1): tip}
    stop = Stop(end)
    session, told = session_after(robot, ControlEnd(stop, may_stand=False))
    outcome = session.outcome
    assert (outcome.label, outcome.exit_code, outcome.is_fault) == ("tilt", 26, True)
    assert outcome.sentence == f"{stop.sentence()}; then the robot fell and lies at 180°; see to it"
    assert "the motors are off; the robot has tipped over: see to it" in told
    assert not any(text.startswith("the robot sits") for text in told)


def test_an_attitude_that_is_no_rotation_says_nothing_about_a_fall() -> None:
    robot = Troubled()

    def spoil() -> None:
        robot.mutate = lambda state: [replace(state, odom_from_body_wxyz=3.0 * LIES)]

    robot.troubles = {("power_off", 1): spoil}
    session, _ = session_after(robot, ControlEnd(Stop(StopReason.STATE_ATTITUDE), may_stand=False))
    assert session.outcome.label == "state_attitude"
    assert "fell" not in session.outcome.sentence


@pytest.mark.parametrize("end", ENDS)
def test_a_robot_that_stays_upright_did_not_fall(end: StopReason) -> None:
    session, told = session_after(Troubled(), ControlEnd(Stop(end), may_stand=False))
    assert (session.outcome.label, session.outcome.exit_code) == (end.label, end.exit_code)
    assert session.outcome.sentence == Stop(end).sentence()
    assert "the robot sits and its motors are off" in told


@pytest.mark.parametrize("end", [end for end in ENDS if end is not StopReason.COMPLETED])
def test_a_body_that_tilted_too_far_after_something_else_decides_the_outcome(end: StopReason) -> None:
    """Upright again, as one that was set on its feet since: the sentence still has both."""
    fall = Stop(StopReason.TILT, "", {"tilt_rad": 1.2, "bound_rad": 0.785})
    session, told = session_after(Troubled(), ControlEnd(Stop(end), may_stand=False, later=(fall,)))
    outcome = session.outcome
    assert (outcome.label, outcome.exit_code, outcome.is_fault) == ("tilt", 26, True)
    assert outcome.sentence == f"{Stop(end).sentence()}; then {fall.sentence()}"
    assert "the robot sits and its motors are off" in told


def test_a_robot_whose_power_off_fails_is_looked_at_too() -> None:
    robot = Troubled()

    def fail() -> None:
        robot.mutate = lambda state: [replace(state, odom_from_body_wxyz=LIES)]
        raise MotionError("the motors do not stop")

    robot.troubles = {("power_off", 1): fail}
    session, told = session_after(robot, ControlEnd(Stop(StopReason.COMPLETED), may_stand=False))
    assert session.outcome.exit_code == 26
    assert "powering off failed" in session.outcome.sentence
    assert session.outcome.sentence.endswith("; then the robot fell and lies at 180°; see to it")
    assert not any("motors are off" in text for text in told)


def test_a_robot_found_lying_at_the_start_is_not_said_to_have_fallen() -> None:
    robot = Troubled(mutate=lambda state: [replace(state, odom_from_body_wxyz=LIES)])
    session, told = session_after(robot, ControlEnd(Stop(StopReason.COMPLETED), may_stand=False))
    assert session.outcome.label == "robot_fault"
    assert session.outcome.exit_code != 26
    assert "set the robot on its belly or feet" in session.outcome.sentence
    assert "fell" not in session.outcome.sentence
    assert "the motors are off; the robot has tipped over: see to it" in told


def test_a_failure_of_what_is_told_of_shutting_down_keeps_no_power_on() -> None:
    robot = Troubled()

    def fail() -> None:
        raise ValueError("a defect")

    with StopSignals() as signals:
        session = RobotSession(signals, lambda *_: None, on_shut_down=fail)
        session.drive(lambda: robot, lambda _: ControlEnd(Stop(StopReason.COMPLETED), may_stand=True))
    assert session.outcome.label == "internal_error"
    assert robot.calls[-2:] == ["power_off", "close"]


def test_an_estop_pressed_while_nothing_waits_is_not_forgotten() -> None:
    with StopSignals() as signals:
        send(signal.SIGQUIT)
        send(signal.SIGTERM)
        with pytest.raises(OperatorInterrupt) as caught:
            signals.interrupt_waits(only_estop=True)
        assert caught.value.stop.reason is StopReason.OPERATOR_ESTOP
        assert signals.take() is None


def test_no_later_signal_displaces_an_estop() -> None:
    with StopSignals() as signals:
        send(signal.SIGQUIT)
        send(signal.SIGTERM)
        stop = signals.take()
    assert stop is not None
    assert stop.reason is StopReason.OPERATOR_ESTOP


def test_a_stand_that_fails_at_the_end_is_no_reason_to_leave_the_power_on(zero_policy: Policy, tmp_path: Path) -> None:
    robot = Troubled(troubles={("stand", 2): refuse("the robot did not stand within 10 s")})
    summary = robot.drive(zero_policy, tmp_path)
    assert (summary.outcome, summary.exit_code) == ("motion_failed", 89)
    assert robot.calls[-2:] == ["power_off", "close"]
    assert robot.said()[-2:] == ["stand_failed", "power_off"]


def test_a_robot_that_falls_while_it_is_handed_back_has_not_completed(zero_policy: Policy, tmp_path: Path) -> None:
    def on_its_side(state: RobotState) -> list[RobotState]:
        has_fallen = robot.calls.count("stand") == 2
        return [replace(state, odom_from_body_wxyz=np.array([0.8, 0.6, 0.0, 0.0])) if has_fallen else state]

    robot = Troubled(mutate=on_its_side)
    summary = robot.drive(zero_policy, tmp_path)
    assert (summary.outcome, summary.exit_code) == ("tilt", 26)
    assert robot.calls[-2:] == ["power_off", "close"]
    assert robot.said()[-3:] == ["stop", "power_off", "incident"]


@pytest.mark.parametrize(
    ("troubles", "outcome", "exit_code"),
    [
        ({}, "power_off_failed", 89),
        ({("stand", 1): lambda: send(signal.SIGTERM)}, "power_off_failed", 89),
        ({("connect", 1): refuse("the robot reports a fault")}, "motion_failed", 89),
        ({("connect", 1): lambda: send(signal.SIGQUIT)}, "operator_estop", 12),
    ],
)
def test_a_robot_that_may_have_power_is_told_of_whatever_ended_the_run(
    zero_policy: Policy,
    tmp_path: Path,
    troubles: dict[tuple[str, int], Callable[[], None]],
    outcome: str,
    exit_code: int,
) -> None:
    robot = Troubled(troubles={**troubles, ("power_off", 1): refuse("the robot did not power off within 20 s")})
    summary = robot.drive(zero_policy, tmp_path)
    assert (summary.outcome, summary.exit_code) == (outcome, exit_code)
    assert "did not power off within 20 s; see to the robot" in summary.sentence
    assert "power_off_failed" in robot.said()


# A disk that takes its time -------------------------------------------------------------------------------------------


def without_lease(troubles: dict[tuple[str, int], Callable[[], None]]) -> Troubled:
    robot = Troubled(troubles=troubles)
    robot.waiting.append(Stop(StopReason.LEASE_LOST, "taken"))
    return robot


def test_no_incident_file_keeps_the_robot_standing(
    zero_policy: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_rest = threading.Event()
    waited: list[bool] = []
    write = FlightRecorder._write

    def slowly(recorder: FlightRecorder, path: Path, header: RunHeader, outcome: str) -> None:
        waited.append(at_rest.wait(60.0))
        write(recorder, path, header, outcome)

    monkeypatch.setattr(FlightRecorder, "_write", slowly)
    robot = without_lease({("power_off", 1): at_rest.set})
    assert robot.drive(zero_policy, tmp_path).outcome == "lease_lost"
    assert waited == [True]
    assert robot.said()[-1] == "incident"
    assert read_run(tmp_path / "incidents" / "run.mcap").outcome == "lease_lost"


def test_a_disk_that_hangs_keeps_no_run_from_its_end(
    zero_policy: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_over = threading.Event()
    monkeypatch.setattr(run_module, "RECORD_TIMEOUT_S", 0.1)
    monkeypatch.setattr(FlightRecorder, "_write", lambda *_: is_over.wait(60.0))
    assert without_lease({}).drive(zero_policy, tmp_path).outcome == "lease_lost"
    is_over.set()


# The e-stop ----------------------------------------------------------------------------------------------------------


class SlowEndpoint:
    """A robot's e-stop by its book: each answer to a challenge is used once, and brings the next challenge.

    It takes its time for a check-in, and acts on it when it comes or, if ``is_late``, just before it answers.
    """

    def __init__(self, *, is_late: bool) -> None:
        self.is_late, self.challenge, self.known, self.level = is_late, 1, 1, "none"
        self.calls: list[str] = []
        self.has_begun, self.may_end = threading.Event(), threading.Event()

    def allow(self, timeout: float) -> None:
        answered, self.calls = self.known, [*self.calls, "allow"]
        if not self.is_late:
            self._take(answered, "none")
        self.has_begun.set()
        assert self.may_end.wait(30.0)
        if self.is_late:
            self._take(answered, "none")
        self.known = self.challenge

    def settle_then_cut(self, timeout: float) -> None:
        answered, self.calls = self.known, [*self.calls, "press"]
        is_right = self._take(answered, "settle")
        self.known = self.challenge
        if not is_right:
            raise IncorrectChallengeResponseError(estop_pb2.EstopCheckInResponse(), "incorrect")

    def _take(self, answered: int, level: str) -> bool:
        is_right = answered == self.challenge
        self.challenge += 1
        self.level = level if is_right else self.level
        return is_right


@pytest.mark.parametrize("is_late", [True, False])
def test_a_press_acts_at_once_though_a_check_in_is_under_way_and_no_other_follows(is_late: bool) -> None:
    endpoint = SlowEndpoint(is_late=is_late)
    own = OwnEstop.__new__(OwnEstop)
    own._lock, own._is_pressed, own._rpc_timeout_s, own._endpoint = threading.Lock(), False, 3.0, endpoint
    checking, pressing = threading.Thread(target=own.check_in), threading.Thread(target=own.press)
    checking.start()
    assert endpoint.has_begun.wait(30.0)
    pressing.start()
    while endpoint.level != "settle" and pressing.is_alive() and len(endpoint.calls) < 4:
        time.sleep(0.001)
    assert (endpoint.level, checking.is_alive()) == ("settle", True)
    endpoint.may_end.set()
    for thread in (checking, pressing):
        thread.join(30.0)
    own.check_in()
    assert endpoint.level == "settle"
    assert (endpoint.calls[0], set(endpoint.calls[1:])) == ("allow", {"press"})


def test_a_press_that_is_refused_beside_a_check_in_is_made_again_after_it() -> None:
    class Unreachable(SlowEndpoint):
        def settle_then_cut(self, timeout: float) -> None:
            if not self.may_end.is_set():
                self.may_end.set()
                raise TimedOutError(ValueError("3 s"), "no answer")
            super().settle_then_cut(timeout)

    endpoint = Unreachable(is_late=False)
    own = OwnEstop.__new__(OwnEstop)
    own._lock, own._is_pressed, own._rpc_timeout_s, own._endpoint = threading.Lock(), False, 3.0, endpoint
    checking = threading.Thread(target=own.check_in)
    checking.start()
    assert endpoint.has_begun.wait(30.0)
    own.press()
    checking.join(30.0)
    assert endpoint.level == "settle"


class Forgetful:
    """An endpoint whose last answer got lost: the robot wants another challenge, and does not stop without it."""

    def __init__(self, refusals: int) -> None:
        self.refusals, self.is_pressed = refusals, False

    def settle_then_cut(self, timeout: float) -> None:
        self.refusals -= 1
        if self.refusals >= 0:
            raise IncorrectChallengeResponseError(estop_pb2.EstopCheckInResponse(), "incorrect")
        self.is_pressed = True


@pytest.mark.parametrize("refusals", [0, 1, 2])
def test_a_press_after_a_lost_answer_is_made_again_with_the_challenge_of_its_refusal(refusals: int) -> None:
    endpoint = Forgetful(refusals)
    own = OwnEstop.__new__(OwnEstop)
    own._lock, own._is_pressed, own._rpc_timeout_s, own._endpoint = threading.Lock(), False, 3.0, endpoint
    with nullcontext() if refusals < 2 else pytest.raises(IncorrectChallengeResponseError):
        own.press()
    assert endpoint.is_pressed is (refusals < 2)


# One check-in ------


@pytest.mark.parametrize(
    ("error", "reason"),
    [(HalError("no answer"), StopReason.LINK_LOST), (EstopError("endpoint unknown"), StopReason.ESTOPPED)],
)
def test_one_failed_check_in_is_no_pressed_estop(
    hal: BosdynHal, monkeypatch: pytest.MonkeyPatch, error: HalError, reason: StopReason
) -> None:
    monkeypatch.setattr(hal._session, "check_in_estop", lambda: None)
    for _ in range(3):
        hal._job_failed("estop", error)
        assert list(hal.problems()) == []
        hal._check_in()
    hal._job_failed("estop", error)
    hal._job_failed("estop", error)
    assert [stop.reason for stop in hal.problems()] == [reason]


# What the adapter keeps ----------------------------------------------------------------------------------------------


@dataclass
class Sent:
    """A command stream that only remembers keys."""

    keys: list[int] = field(default_factory=list)

    def put(self, key: int, wire: bytes) -> None:
        self.keys.append(key)

    def stop(self) -> None: ...


@pytest.fixture
def hal(monkeypatch: pytest.MonkeyPatch) -> BosdynHal:
    hal = BosdynHal(parse_address("127.0.0.1:1"), RunConfig(), MemorySink())
    sent = Sent()
    monkeypatch.setattr(hal, "_commands", sent)
    monkeypatch.setattr(hal, "_send", sent.put)
    return hal


def test_where_the_stand_does_not_take_the_joints_back_damping_still_goes_out(
    hal: BosdynHal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hal, "_joint_control", JointControl.LEAVING)
    hal._leave(hal._motions())  # there is no connection
    assert [stop.reason for stop in hal.problems()] == [StopReason.HAND_BACK_FAILED]
    zeros = np.zeros(12)
    hal.send(JointCommand(7, zeros, zeros, zeros, Gains(zeros, zeros), 1))
    sent: Any = hal._commands
    assert sent.keys == [7]


def test_a_robot_whose_lease_was_lost_is_not_said_to_be_powered_off(
    hal: BosdynHal, monkeypatch: pytest.MonkeyPatch
) -> None:
    hal.power_off()  # there never was a lease, and nothing to power off
    monkeypatch.setattr(hal._session, "_lease", SimpleNamespace(lease_proto=object()))
    with pytest.raises(LeaseHeldError, match="the lease is gone, and THE ROBOT MAY HAVE POWER"):
        hal.power_off()
    assert hal.joint_control is JointControl.OFF


@pytest.mark.parametrize(("cut_after_s", "is_off"), [(0.5, True), (1e6, False)])
def test_a_robot_that_refuses_to_power_off_while_an_estop_cuts_its_power_is_off_all_the_same(
    monkeypatch: pytest.MonkeyPatch, cut_after_s: float, is_off: bool
) -> None:
    waited: list[float] = []
    motions = Motions(
        Calls(),
        RobotConfig(),
        helm=Helm(lambda: None),
        is_powered=lambda: True,
        is_without_power=lambda: sum(waited) >= cut_after_s,
        pause=waited.append,
    )
    monkeypatch.setattr(motions, "_command", lambda *_: refuse("powering off: NotPoweredOnError")())
    with nullcontext() if is_off else pytest.raises(MotionError, match="NotPoweredOnError"):
        motions.power_off()
    assert sum(waited) == pytest.approx(min(cut_after_s, CUT_S), abs=0.06)


@pytest.mark.parametrize(("under_way_s", "is_on"), [(0.0, True), (1.0, True), (1e6, False)])
def test_a_change_of_power_that_is_under_way_is_waited_for(under_way_s: float, is_on: bool) -> None:
    waited: list[float] = []

    def power_command(_request: Any, timeout: float) -> Any:
        if sum(waited) < under_way_s:
            raise CommandInProgressError(power_pb2.PowerCommandResponse(), "cannot be overwritten")
        return power_pb2.PowerCommandResponse(status=power_pb2.STATUS_SUCCESS)

    robot = SimpleNamespace(ensure_client=lambda _name: SimpleNamespace(power_command=power_command))
    config = RobotConfig()
    motions = Motions(
        Calls(robot),
        config,
        helm=Helm(lambda: None),
        is_powered=lambda: False,
        is_without_power=lambda: True,
        pause=waited.append,
    )
    with nullcontext() if is_on else pytest.raises(MotionError, match="cannot be overwritten"):
        motions.power_on()
    assert sum(waited) == pytest.approx(min(under_way_s, config.power_timeout_s), abs=0.06)


@pytest.mark.parametrize(
    ("starts_s", "loses_power_s", "stands"), [(0.0, 1e6, True), (1.0, 1e6, True), (1e6, 1e6, False), (1e6, 0.5, False)]
)
def test_motors_that_have_just_got_power_may_need_a_moment_until_the_robot_stands(
    starts_s: float, loses_power_s: float, stands: bool
) -> None:
    """The status for motors without power is waited out as long as the robot says that they have some."""
    waited: list[float] = []
    config = RobotConfig()

    def robot_command(*_: Any, **__: Any) -> int:
        if sum(waited) < starts_s:
            raise NotPoweredOnError(robot_command_pb2.RobotCommandResponse(), "still starting")
        return 7

    def robot_command_feedback(*_: Any, **__: Any) -> Any:
        answer = robot_command_pb2.RobotCommandFeedbackResponse()
        mobility = answer.feedback.synchronized_feedback.mobility_command_feedback
        mobility.status, mobility.stand_feedback.status = 1, 1
        return answer

    robot = SimpleNamespace(
        ensure_client=lambda _name: SimpleNamespace(
            robot_command=robot_command, robot_command_feedback=robot_command_feedback, synced=lambda send: send()
        )
    )
    motions = Motions(
        Calls(robot),
        config,
        helm=Helm(lambda: None),
        is_powered=lambda: sum(waited) < loses_power_s,
        is_without_power=lambda: False,
        pause=waited.append,
    )
    with nullcontext() if stands else pytest.raises(MotionError, match="still starting"):
        motions.stand()
    assert sum(waited) == pytest.approx(min(starts_s, loses_power_s, config.power_timeout_s), abs=0.06)


# A terminal that goes away -------------------------------------------------------------------------------------------


def test_a_terminal_that_is_gone_asks_to_stop_and_leaves_without_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "rb", buffering=0) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        keys = TerminalKeys()
        os.write(ours, b"w")
        while not (pressed := keys.read()):
            time.sleep(0.001)
        assert pressed == "w"
        os.close(ours)
        assert keys.read() == QUIT
        keys.close()
        keys.close()
