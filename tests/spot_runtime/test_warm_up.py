"""A tick's state is awaited awake, after a dry run that changes nothing."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from spot_log.write.sink import MemorySink
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.policy import Policy, policy_from_bytes
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.warm_up import ARRIVALS, AWAKE_NS, JUDGED, LEAD_NS, Arrivals, WarmReceiver
from spot_tools.sources import ScriptedSource
from tests.spot_runtime.conftest import START_NS, HandMadeRobot, make_state, policy_bytes

MS = 1_000_000
DELAY_NS = 2 * MS
POLL_NS = 10_000


@dataclass
class PunctualRobot(HandMadeRobot):
    """Its host clock runs while it is waited for, and a state comes at its instant, not before."""

    host_ns: int = START_NS + DELAY_NS
    asked_s: list[float] = field(default_factory=list)
    late_ns: int = 0

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        self.asked_s.append(timeout_s)
        arrival_ns = self.now_ns + 3 * MS + DELAY_NS + self.late_ns
        if self.host_ns + round(timeout_s * 1e9) < arrival_ns:
            self.host_ns += max(POLL_NS, round(timeout_s * 1e9))
            return []
        self.host_ns = max(self.host_ns, arrival_ns)
        return [replace(state, host_stamp_ns=self.host_ns) for state in super().receive(until_robot_ns, timeout_s)]

    def host_now_ns(self) -> int:
        return self.host_ns


def state_at(robot_ns: int, host_ns: int) -> RobotState:
    return replace(make_state(robot_ns), host_stamp_ns=host_ns)


def warm_receiver(robot: PunctualRobot, *, may_poll: bool = True) -> WarmReceiver:
    wait = WarmReceiver(robot, may_poll=may_poll)
    wait.arrivals.add(state_at(robot.now_ns, robot.now_ns + DELAY_NS))
    return wait


def test_the_quickest_recent_state_says_when_the_next_one_may_come() -> None:
    arrivals = Arrivals()
    assert arrivals.earliest_host_ns(0) is None
    for delay_ns in (3 * MS, 2 * MS, 4 * MS):
        arrivals.add(state_at(10 * MS, 10 * MS + delay_ns))
    assert arrivals.earliest_host_ns(20 * MS) == 22 * MS
    for _ in range(ARRIVALS):
        arrivals.add(state_at(10 * MS, 10 * MS + 5 * MS))
    assert arrivals.earliest_host_ns(20 * MS) == 25 * MS


def test_it_takes_a_dry_run_shortly_before_and_then_polls() -> None:
    robot, at = PunctualRobot(), []
    newest = state_at(robot.now_ns, robot.host_ns)
    states = warm_receiver(robot).receive(newest, 0, 0.004, lambda: at.append(robot.host_ns))
    assert at == [robot.host_ns - LEAD_NS]
    assert [state.robot_stamp_ns for state in states] == [newest.robot_stamp_ns + 3 * MS]
    assert robot.asked_s == [pytest.approx(0.002)] + [0.0] * (LEAD_NS // POLL_NS + 1)


def test_without_a_real_time_priority_it_sleeps_after_the_dry_run() -> None:
    robot, at = PunctualRobot(), []
    newest = state_at(robot.now_ns, robot.host_ns)
    states = warm_receiver(robot, may_poll=False).receive(newest, 0, 0.004, lambda: at.append(robot.host_ns))
    assert len(at) == len(states) == 1
    assert robot.asked_s == pytest.approx([0.002, 0.002])


def test_dry_runs_end_where_they_would_delay_the_tick_they_are_for() -> None:
    robot, took = PunctualRobot(), []
    wait = warm_receiver(robot)

    def dry_run(took_ns: int) -> None:
        took.append(took_ns)
        robot.host_ns += took_ns

    def ticks(count: int, took_ns: int) -> None:
        for _ in range(count):
            robot.host_ns = robot.now_ns + DELAY_NS
            wait.receive(state_at(robot.now_ns, robot.host_ns), 0, 0.01, lambda: dry_run(took_ns))

    ticks(2 * JUDGED, LEAD_NS // 2)
    assert len(took) == 2 * JUDGED
    ticks(JUDGED - 1, 4 * MS)  # a computer that is busy for a moment
    ticks(1, LEAD_NS // 2)
    ticks(2 * JUDGED, 4 * MS)
    assert len(took) == 4 * JUDGED


def test_a_state_that_comes_before_the_dry_run_is_answered_without_it() -> None:
    robot = PunctualRobot(late_ns=-MS)
    states = warm_receiver(robot).receive(state_at(robot.now_ns, robot.host_ns), 0, 0.004, pytest.fail)
    assert len(states) == 1


def test_a_loop_that_was_busy_takes_a_late_dry_run_and_one_that_was_too_busy_only_waits() -> None:
    robot, at = PunctualRobot(), []
    newest = state_at(robot.now_ns, robot.host_ns)
    robot.host_ns += 3 * MS - LEAD_NS // 2
    assert len(warm_receiver(robot).receive(newest, 0, 0.004, lambda: at.append(robot.host_ns))) == 1
    assert at == [robot.host_ns - LEAD_NS // 2 + POLL_NS]
    robot = PunctualRobot()
    robot.host_ns += 3 * MS - LEAD_NS // 2 + 1
    assert len(warm_receiver(robot).receive(newest, 0, 0.004, pytest.fail)) == 1
    assert robot.asked_s == [0.004]


def test_a_state_that_never_comes_costs_little_and_no_more_time_than_was_given() -> None:
    robot = PunctualRobot(late_ns=1000 * MS)
    begin_ns = robot.host_ns
    assert warm_receiver(robot).receive(state_at(robot.now_ns, begin_ns), 0, 0.02, lambda: None) == []
    assert robot.host_ns - begin_ns == 20 * MS
    assert robot.asked_s.count(0.0) == AWAKE_NS // POLL_NS


def test_polling_ends_with_the_time_that_was_given() -> None:
    robot = PunctualRobot(late_ns=1000 * MS)
    begin_ns = robot.host_ns
    assert warm_receiver(robot).receive(state_at(robot.now_ns, begin_ns), 0, 0.004, lambda: None) == []
    assert 0 <= robot.host_ns - begin_ns - 4 * MS <= POLL_NS


def walking_policy() -> Policy:
    return policy_from_bytes(policy_bytes(weight=np.full((48, 12), 0.01)), source="test")


def run(policy: Policy, **control: Any) -> tuple[PunctualRobot, MemorySink]:
    robot, sink = PunctualRobot(), MemorySink()
    config = RunConfig.model_validate({"control": control})
    loop = ControlLoop(robot, policy, ScriptedSource(standing_sequence(0.5)), config, sink, wall_s=lambda: 0.0)
    for _ in range(3000):
        if loop.is_done:
            return robot, sink
        loop.cycle()
    raise AssertionError(f"the loop is still {loop.mode.value}")


def test_a_run_with_dry_runs_sends_bit_for_bit_what_one_without_sends() -> None:
    policy, plain = walking_policy(), walking_policy()
    robot, sink = run(policy, warm_up=True)
    other, other_sink = run(plain, warm_up=False)
    assert [c.position_rad.tobytes() for c in robot.sent] == [c.position_rad.tobytes() for c in other.sent]
    assert [t.observation.tobytes() for t in sink.ticks] == [t.observation.tobytes() for t in other_sink.ticks]
    assert len({c.position_rad.tobytes() for c in robot.sent}) > 10
    # It did take dry runs: it woke before the states of ticks.
    assert len(robot.asked_s) > len(other.asked_s)
