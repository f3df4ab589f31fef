"""A robot gets power, and keeps it, only while a guardian watches; one that ends is told of and replaced."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from spot_log.format.records import RunHeader
from spot_log.write.logger_process import CLOSE_TIMEOUT_S
from spot_log.write.sink import LogSink, MemorySink, NullSink
from spot_model.policy.policy import Policy
from spot_model.process.child_process import ChildProcess
from spot_model.robot.state import RobotState
from spot_protos import operator_pb2
from spot_runtime.config import HandoverConfig, RobotConfig, RunConfig, for_lock_step
from spot_runtime.hal.base import RobotInfo
from spot_runtime.hal.errors import HalError
from spot_runtime.hal.spot.calls import Calls
from spot_runtime.hal.spot.motions import Helm, Motions
from spot_runtime.operator.run.link import RunLink
from spot_runtime.operator.run.operated_run import OperatedRun
from spot_runtime.operator.run.run_spec import RunSpec
from spot_runtime.rescue import guarded
from spot_runtime.rescue.guarded import CALLS_IN_A_ROW, LASTS_S, MOST_ENDS, GuardianKeeper, longest_silence_s
from spot_runtime.rescue.guardian import Heartbeat
from tests.spot_runtime.conftest import HandMadeRobot

from .conftest import Operator


@dataclass
class Guardian:
    """Stands in for the process; it begins to watch, or ends, at one of the waits for it."""

    heartbeat: Heartbeat
    watches_at: int = 1
    ends_at: int = 1000
    waits: int = 0
    code: int | None = None

    def wait(self, timeout_s: float | None = None) -> int | None:
        if self.code == -9:
            return self.code
        self.waits += 1
        if self.waits >= self.watches_at:
            self.heartbeat.look()
        self.code = 1 if self.waits >= self.ends_at else None
        return self.code

    @property
    def exit_code(self) -> int | None:
        return self.code

    @property
    def end_in_words(self) -> str:
        return f"exit code {self.code}"

    def end(self, timeout_s: float = 0.0) -> int:
        self.code = -9
        return self.code

    def kill(self) -> None:
        self.code = -9


class Kept:
    """A keeper, what it has started, and what it has told."""

    def __init__(self, make: Callable[[Heartbeat], Guardian] = Guardian) -> None:
        self.heartbeat = Heartbeat.new()
        self.started: list[Guardian] = []
        self.told: list[str] = []
        self.given_up: list[str] = []
        self.error = ""
        self._make = make
        self.keeper = GuardianKeeper(self._start, self.heartbeat, self.told.append, self.given_up.append)

    def _start(self) -> ChildProcess:
        if self.error:
            raise OSError(self.error)
        self.started.append(self._make(self.heartbeat))
        return self.started[-1]  # type: ignore[return-value]


def test_it_waits_until_the_guardian_watches() -> None:
    kept = Kept(lambda heartbeat: Guardian(heartbeat, watches_at=5))
    kept.keeper.begin()
    assert kept.started[0].waits == 5
    kept.keeper.look(1.0)
    assert (len(kept.started), kept.told) == (1, [])


def test_without_one_that_watches_nobody_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "WATCHES_WITHIN_S", 0.1)
    ends = Kept(lambda heartbeat: Guardian(heartbeat, watches_at=1000, ends_at=3))
    with pytest.raises(HalError, match=r"no guardian watches.*it ended at once, exit code 1; see to this computer"):
        ends.keeper.begin()
    sleeps = Kept(lambda heartbeat: Guardian(heartbeat, watches_at=1000))
    with pytest.raises(HalError, match=r"it did not begin within 0\.1 s"):
        sleeps.keeper.begin()
    assert sleeps.started[0].code == -9
    none = Kept()
    none.error = "Resource temporarily unavailable"
    with pytest.raises(HalError, match="Resource temporarily unavailable"):
        none.keeper.begin()


def test_one_that_ends_is_told_of_and_replaced_at_once_and_after_too_many_the_robot_must_sit() -> None:
    kept = Kept()
    kept.keeper.begin()
    for second in range(1, 9):
        kept.started[-1].code = 1  # none of them lives for long
        kept.keeper.look(float(second))
        assert bool(kept.given_up) == (second > MOST_ENDS)
        assert not kept.heartbeat.looks
        kept.heartbeat.look()
    assert len(kept.started) == 9
    assert kept.told == ["the guardian has ended (exit code 1); another one was started"] * (MOST_ENDS + 1)
    assert kept.given_up == ["6 ended in a row, and nobody has watched for 6 s"]


def test_ends_count_anew_after_one_that_lasted() -> None:
    kept = Kept()
    kept.keeper.begin()
    for number in range(20):
        began_s = number * (LASTS_S + 3.0)
        kept.started[-1].code = 1
        kept.keeper.look(began_s)
        kept.heartbeat.look()
        kept.keeper.look(began_s + 1.0)
        kept.heartbeat.look()
        kept.keeper.look(began_s + LASTS_S + 1.0)  # it lives
    assert (len(kept.started), kept.given_up) == (21, [])


def test_a_robot_that_nobody_has_guarded_for_long_must_sit() -> None:
    for error, ends in (("no memory", False), ("", False), ("", True)):  # none starts; it never watches; nor lives
        kept = Kept()
        kept.keeper.begin()
        kept.started[-1].code, kept.error = 1, error
        for second in range(11):
            assert kept.given_up == []
            kept.keeper.look(100.0 + second)
            if ends and second % 4 == 3:
                kept.started[-1].code = 1
        assert len(kept.given_up) == 1, "once is enough"
        assert "nobody has watched for 11 s" in kept.given_up[0]


def test_one_that_no_longer_looks_is_killed_and_replaced() -> None:
    kept = Kept()
    kept.keeper.begin()
    kept.heartbeat.looks = 254
    for second in range(5):
        kept.heartbeat.look()
        kept.keeper.look(100.0 + second)
    assert kept.heartbeat.looks == 4
    for second in range(3):  # it is stopped
        assert kept.started[0].code is None
        kept.keeper.look(105.0 + second)
    assert kept.started[0].code == -9
    assert kept.told == ["the guardian hung: it had not looked for 3.0 s and was killed; another one was started"]
    kept.heartbeat.look()
    kept.keeper.look(111.0)
    assert (len(kept.started), kept.given_up) == (2, [])


def test_one_that_watches_within_time_is_enough() -> None:
    kept = Kept()
    kept.keeper.begin()
    for failure in range(3):
        kept.started[-1].code = 1
        for second in range(10):
            kept.keeper.look(100.0 * failure + second)
        kept.heartbeat.look()
        kept.keeper.look(100.0 * failure + 10.0)
    assert (len(kept.started), kept.given_up) == (4, [])


def test_that_none_can_be_started_is_told_each_time() -> None:
    kept = Kept()
    kept.keeper.begin()
    kept.started[-1].code, kept.error = 1, "no memory"
    for second in (1.0, 2.0):
        kept.keeper.look(second)
    lost = "none can be started: no memory; if this program dies, the robot may be left with power"
    assert kept.told == [f"the guardian has ended (exit code 1), and {lost}", f"no guardian, and {lost}"]


# What a control process may do without a beat ------------------------------------------------------------------------


def test_the_longest_silence_covers_all_that_may_take_long() -> None:
    assert longest_silence_s(RobotConfig(rpc_timeout_s=0.5)) == 5.0 + CLOSE_TIMEOUT_S == 15.0
    assert longest_silence_s(RobotConfig(rpc_timeout_s=3.0)) == 5.0 + 4 * 3.0
    assert longest_silence_s(RobotConfig(rpc_timeout_s=30.0)) == 5.0 + 4 * 30.0


class Answers(Calls):
    """Answers everything at once, in the order of a script, and counts the calls since the last pause."""

    def __init__(self, answers: Sequence[object]) -> None:
        super().__init__()
        self.answers = list(answers)
        self.in_a_row = self.most = 0

    def count(self, answer: object) -> object:
        self.in_a_row += 1
        self.most = max(self.most, self.in_a_row)
        return answer

    def client(self, kind: object) -> object:
        return None

    def make(self, doing: str, call: Callable[[], object]) -> object:
        return self.count(self.answers.pop(0))

    def pause(self, duration_s: float) -> None:
        self.in_a_row = 0


def test_no_more_calls_in_a_row_than_the_silence_allows() -> None:
    from bosdyn.api import power_pb2, robot_command_pb2

    stands = robot_command_pb2.RobotCommandFeedbackResponse()
    mobility = stands.feedback.synchronized_feedback.mobility_command_feedback
    mobility.status = 1
    rises = robot_command_pb2.RobotCommandFeedbackResponse()
    rises.CopyFrom(stands)
    mobility.stand_feedback.status = 1
    powers = power_pb2.PowerCommandResponse(status=power_pb2.STATUS_SUCCESS)
    calls = Answers([powers, "stand", rises, stands, "off"])
    has_power = iter([False, True, True])
    motions = Motions(
        calls,
        RobotConfig(),
        helm=Helm(lambda: None),
        is_powered=lambda: bool(calls.count(next(has_power))),
        is_without_power=lambda: not calls.count(next(has_power, False)),
        pause=calls.pause,
    )
    motions.power_on()
    motions.stand()
    assert calls.most == CALLS_IN_A_ROW
    motions.power_off()
    assert calls.most == CALLS_IN_A_ROW


@dataclass
class Watching(HandMadeRobot):
    """Each wait for a state is an occasion for the operator, who walks, stands, and sits down."""

    operator: Operator = field(default_factory=Operator)
    waits: int = 0
    asks: list[tuple[str, dict[str, object]]] = field(
        default_factory=lambda: [
            ("armed", {"start": operator_pb2.StartRequest()}),
            ("running", {"stop": operator_pb2.StopRequest(keep_standing=True)}),
            ("armed", {"stop": operator_pb2.StopRequest()}),
        ]
    )

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        self.waits += 1
        self.operator.read()
        states = self.operator.states
        if self.waits % 100 == 0:
            self.operator.attend()
        if self.asks and states[-1:] == [self.asks[0][0]]:  # each once, however long its answer takes
            self.operator.send(**self.asks.pop(0)[1])
        return super().receive(until_robot_ns, timeout_s)


@dataclass
class SlowLog(NullSink):
    """Takes its time to close: until its robot has been looked at three times more."""

    robot: Watching
    looks: int = 0

    def close(self, outcome: str) -> None:
        before, until_s = self.robot.waits, time.monotonic() + 20.0  # the bound only ends a hang
        while self.robot.waits < before + 3 and time.monotonic() < until_s and self.looks == 0:
            time.sleep(0.01)
        self.looks = self.looks or self.robot.waits - before


def test_a_standing_robot_is_looked_after_while_its_log_closes(zero_policy: Policy, tmp_path: Path) -> None:
    config = for_lock_step(RunConfig(handover=HandoverConfig(ramp_in_s=0.1, soft_stop_s=0.0, soft_stop_settle_s=0.0)))
    config = config.model_copy(update={"log": config.log.model_copy(update={"directory": tmp_path})})
    robot, logs = Watching(), list[SlowLog]()

    def make_sink(path: Path, header: RunHeader) -> LogSink:
        logs.append(SlowLog(robot))
        return logs[-1]

    link = RunLink(robot.operator.theirs)
    spec = RunSpec(robot="by hand", config=config, policy=tmp_path, policy_sha256="")
    outcome = OperatedRun(spec, zero_policy, link, make_sink, manager=None).drive(lambda _: robot)
    link.close()
    robot.operator.ours.close()
    assert outcome.outcome == "operator_stop", outcome.sentence
    assert [log.looks >= 3 for log in logs] == [True]


@pytest.mark.parametrize("asks", [1, 3], ids=["it opens", "it closes"])
def test_a_stop_does_not_wait_for_a_log(zero_policy: Policy, tmp_path: Path, asks: int) -> None:
    hand_over = HandoverConfig(ramp_in_s=0.1, soft_stop_s=0.0, soft_stop_settle_s=0.0)
    config = RunConfig(handover=hand_over, real_time=for_lock_step(RunConfig()).real_time)
    config = config.model_copy(update={"log": config.log.model_copy(update={"directory": tmp_path})})
    is_at_rest = threading.Event()
    waits: list[bool] = []

    class Hurried(Watching):
        def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
            time.sleep(1e-4)
            if not self.asks and "asked" not in self.calls and (asks == 1 or self.operator.states[-1:] == ["arming"]):
                self.calls.append("asked")
                self.operator.send(stop=operator_pb2.StopRequest())
            return super().receive(until_robot_ns, timeout_s)

        def power_off(self) -> None:
            super().power_off()
            is_at_rest.set()

    class Stuck(NullSink):
        def close(self, outcome: str) -> None:
            waits.append(asks == 1 or is_at_rest.wait(60.0))

    def make_sink(path: Path, header: RunHeader) -> LogSink:
        waits.append(asks == 3 or is_at_rest.wait(60.0))
        return Stuck()

    robot = Hurried()
    robot.asks = robot.asks[: asks - 1] or robot.asks[:1]
    link = RunLink(robot.operator.theirs)
    spec = RunSpec(robot="by hand", config=config, policy=tmp_path, policy_sha256="")
    outcome = OperatedRun(spec, zero_policy, link, make_sink, manager=None).drive(lambda _: robot)
    robot.operator.read()
    link.close()
    robot.operator.ours.close()
    assert outcome.outcome == "operator_stop", outcome.sentence
    assert waits == [True, True]
    assert robot.operator.states[-1] == "ending"


@dataclass
class Connecting(HandMadeRobot):
    """Cannot be connected to."""

    def connect(self) -> RobotInfo:
        super().connect()
        raise HalError("not today")


def test_a_policy_is_warm_before_the_robot_is_touched(
    zero_policy: Policy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Connecting()
    monkeypatch.setattr(Policy, "warm_up", lambda _: robot.calls.append("warm_up"))
    operator = Operator()
    link = RunLink(operator.theirs)
    spec = RunSpec(robot="by hand", config=for_lock_step(RunConfig()), policy=tmp_path, policy_sha256="")
    OperatedRun(spec, zero_policy, link, lambda *_: MemorySink(), manager=None).drive(lambda _: robot)
    link.close()
    operator.ours.close()
    assert robot.calls[:2] == ["warm_up", "connect"]
