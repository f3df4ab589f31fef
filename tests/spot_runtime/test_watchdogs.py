"""The watchdogs one by one, on a robot written by hand."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spot_log.format.events import EventName
from spot_log.write.sink import MemorySink, SinkHealth
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.watchdogs import WINDOW_KEYS, LossMemory, WatchMemory, lost_ticks, screen
from spot_runtime.control.safety.watchdogs import look as watch
from spot_runtime.control.snapshot import Notes, Phase, Snapshot
from spot_runtime.control.step import with_own_doing
from spot_runtime.host.pauses import CpuWait, Pause, Pauses
from spot_runtime.stops import Stop, StopReason

MS = 1_000_000
S = 1000 * MS
START_NS = 1_700_000_000_000_000_000
CONFIG = RunConfig()
MakeState = Callable[..., RobotState]


class SickSink(MemorySink):
    """A log whose health a test sets."""

    def __init__(self) -> None:
        super().__init__()
        self.told = SinkHealth(is_alive=True, dropped={}, unwritten={})
        self.asked = 0

    def health(self) -> SinkHealth:
        self.asked += 1
        return self.told


class Dogs:
    """The watchdogs with their memory, and what they tell."""

    def __init__(self, robot: Any, sink: SickSink, config: RunConfig = CONFIG) -> None:
        self.robot, self.sink, self.config = robot, sink, config
        self.memory, self.told = WatchMemory(), frozenset[tuple[EventName, str]]()

    @property
    def newest(self) -> RobotState | None:
        return self.memory.newest

    @property
    def missed_states(self) -> int:
        return self.memory.states.missed

    def screen(self, states: list[RobotState], now_ns: int) -> tuple[list[RobotState], list[Stop]]:
        notes = self._notes(now_ns)
        self.memory, usable, stops = screen(self.memory, states, now_ns, self.config.safety, notes)
        self._keep(notes)
        return usable, list(stops)

    def lost_ticks(self, lost: int, stamp_ns: int) -> Stop | None:
        notes = self._notes(stamp_ns)
        self.memory, stops = lost_ticks(self.memory, lost, stamp_ns, self.config.safety, notes)
        self._keep(notes)
        return stops[0] if stops else None

    def look(self, phase: Phase, now_ns: int) -> list[Stop]:
        notes, robot = self._notes(now_ns), self.robot
        log = self.sink.health() if now_ns >= self.memory.next_log_check_ns else None
        now = Snapshot(
            now_ns, now_ns, (), robot.joint_control, robot.problems(), robot.slow_state, robot.clock_age_s, log
        )
        self.memory, stops = watch(self.memory, now, phase, self.config, notes)
        self._keep(notes)
        return list(stops)

    def _notes(self, now_ns: int) -> Notes:
        return Notes(self.told, now_ns, now_ns)

    def _keep(self, notes: Notes) -> None:
        self.told = notes.told
        for event in notes.events:
            self.sink.put(event)


@pytest.fixture
def sink() -> SickSink:
    return SickSink()


@pytest.fixture
def dogs(robot: Any, sink: SickSink) -> Dogs:
    robot.now_ns = START_NS
    return Dogs(robot, sink)


def look(
    dogs: Dogs,
    mode: Mode = Mode.ACTIVE,
    now_ns: int = START_NS,
    *,
    mode_since_ns: int | None = None,
    control_since_ns: int | None = None,
) -> list[Stop]:
    dogs.robot.now_ns = now_ns
    since_ns = now_ns if mode_since_ns is None else mode_since_ns
    control_since_ns = now_ns if control_since_ns is None else control_since_ns
    return dogs.look(Phase(mode, since_ns, control_since_ns=control_since_ns), now_ns)


def test_a_time_sync_that_fails_for_long_is_told_of_once(dogs: Dogs, sink: SickSink, robot: Any) -> None:
    late_s = CONFIG.robot.time_sync_period_s + CONFIG.safety.clock_unsynced_warn_s
    for n, clock_age_s in enumerate((0.0, late_s, late_s + 0.5, late_s + 9.0)):
        robot.clock_age_s = clock_age_s
        assert look(dogs, now_ns=START_NS + n * S) == []
    (event,) = sink.events
    assert (event.name, event.values) == ("clock_unsynced", {"late_s": 10.5, "bound_s": 10.0})
    assert event.text == "no time sync has succeeded for 12.5 s; check the link"


def test_states_are_screened_one_after_the_other(dogs: Dogs, sink: SickSink, make_state: MakeState) -> None:
    first, second = make_state(START_NS), make_state(START_NS + 3 * MS)
    broken = make_state(START_NS + 6 * MS, load_nm=np.full(12, np.nan))
    usable, stops = dogs.screen([first, second], START_NS + 5 * MS)
    assert (usable, stops, sink.events) == ([first, second], [], [])
    usable, stops = dogs.screen([first, broken], START_NS + 8 * MS)
    assert (usable, [s.reason for s in stops]) == ([], [StopReason.STATE_NOT_FINITE])
    assert dogs.newest is second
    assert [e.name for e in sink.events] == ["state_rejected"]
    dogs.screen([first], START_NS + 8 * MS)
    assert len(sink.events) == 1


def test_nothing_that_arrives_changes_nothing(dogs: Dogs) -> None:
    before = dogs.memory
    assert dogs.screen([], START_NS) == ([], [])
    assert dogs.memory is before


def test_missed_states_are_told_of_once_and_counted(dogs: Dogs, sink: SickSink, make_state: MakeState) -> None:
    dogs.screen([make_state(START_NS + ms * MS) for ms in (0, 3, 12, 15, 21)], START_NS + 21 * MS)
    assert dogs.missed_states == 3
    assert [e.name for e in sink.events] == ["states_missed"]


def test_lost_commands_are_told_of_once(dogs: Dogs, sink: SickSink, make_state: MakeState) -> None:
    for i in range(WINDOW_KEYS // 4):
        dogs.screen([make_state(START_NS + 3 * i * MS, last_command_key=1 + 5 * i)], START_NS + 3 * i * MS)
    assert [e.name for e in sink.events] == ["commands_lost"]
    assert sink.events[0].values["share"] > 0.4
    assert sink.events[0].values["bound"] == 0.15
    assert sink.events[0].text == f"about {sink.events[0].values['share']:.0%} of commands are lost"


@pytest.mark.parametrize(("share", "is_told"), [(0.15, False), (0.1500001, True)])
def test_losses_are_told_of_beyond_their_bound(
    share: float, is_told: bool, dogs: Dogs, sink: SickSink, make_state: MakeState
) -> None:
    dogs.memory = dogs.memory._replace(losses=LossMemory(first_key=1, newest_key=1, share=share))
    dogs.screen([make_state(START_NS, last_command_key=2)], START_NS)
    assert [e.name for e in sink.events] == ["commands_lost"] * is_told


def test_no_loss_is_told_of_where_none_is(dogs: Dogs, sink: SickSink, make_state: MakeState) -> None:
    for i in range(2 * WINDOW_KEYS):
        dogs.screen([make_state(START_NS + 3 * i * MS, last_command_key=1 + i)], START_NS + 3 * i * MS)
    assert sink.events == []


def test_a_healthy_robot_gives_no_stop(dogs: Dogs, make_state: MakeState, sink: SickSink) -> None:
    dogs.screen([make_state(START_NS)], START_NS)
    assert [look(dogs, mode) for mode in Mode] == [[]] * len(Mode)
    assert sink.events == []


def test_what_the_adapter_reports_comes_first(dogs: Dogs, robot: Any) -> None:
    robot.waiting.append(Stop(StopReason.LEASE_LOST, "tablet"))
    robot.slow = replace(robot.slow, estopped=True)
    assert look(dogs) == [Stop(StopReason.LEASE_LOST, "tablet"), Stop(StopReason.ESTOPPED)]


def test_without_a_slow_state_nothing_is_judged_by_it(dogs: Dogs, robot: Any) -> None:
    robot.slow = None
    assert look(dogs) == []


def test_the_warning_of_an_old_state(dogs: Dogs, sink: SickSink, make_state: MakeState) -> None:
    dogs.screen([make_state(START_NS)], START_NS)
    assert look(dogs, now_ns=START_NS + 15 * MS) == []
    assert sink.events == []
    for _ in range(2):
        assert look(dogs, now_ns=START_NS + 16 * MS) == []
    assert [(e.name, e.text, e.values) for e in sink.events] == [
        ("state_old", "the newest state is 16.0 ms old", {"age_s": 0.016, "bound_s": 0.015})
    ]


def test_ages_count_in_every_mode_but_ready(dogs: Dogs, make_state: MakeState) -> None:
    dogs.screen([make_state(START_NS)], START_NS)
    for mode in Mode:
        stops = look(dogs, mode, START_NS + 50 * MS)
        assert [s.reason for s in stops] == ([] if mode is Mode.READY else [StopReason.STATE_STALE])


BUSY = "this computer is too busy; a thread of this program had to wait"
OWN = "this program did not look for 48.0 ms, though it had a processor: it, or what this computer runs on, was busy"
LINK = "the robot or the link was late; this program looked in time, and none of its threads waited more than"


@pytest.mark.parametrize(
    ("pause", "reason", "words"),
    [
        (Pause(0.0), StopReason.STATE_STALE, ""),
        (Pause(0.0, 0.0, 0.0), StopReason.STATE_STALE, f"{LINK} 0.0 ms"),
        (Pause(0.0, 0.0, 0.0249), StopReason.STATE_STALE, f"{LINK} 24.9 ms"),
        (Pause(0.0, 0.0, 0.025), StopReason.STATE_STALE, f"{BUSY} 25.0 ms"),
        (Pause(0.3, 0.0, 0.3), StopReason.STATE_STALE, f"{BUSY} 300.0 ms"),
        (Pause(0.048, 0.04, 0.001), StopReason.STATE_STALE, OWN),
        (Pause(0.048, 0.001, 0.001), StopReason.PROCESS_PAUSED, "for 0.048 s"),
        (Pause(3.0, 0.001, None), StopReason.PROCESS_PAUSED, "for 3 s"),
        (Pause(3.0, 0.001, 0.0, ago_s=1.0), StopReason.PROCESS_PAUSED, "for 3 s"),
        (Pause(0.048, 0.001, 0.0, ago_s=1.0), StopReason.STATE_STALE, f"{LINK} 0.0 ms"),
    ],
)
def test_a_stale_state_tells_whose_doing_it_is(
    dogs: Dogs, make_state: MakeState, pause: Pause, reason: StopReason, words: str
) -> None:
    dogs.screen([make_state(START_NS)], START_NS)
    (found,) = dogs.look(Phase(Mode.ACTIVE, START_NS, START_NS, START_NS, START_NS), START_NS + 50 * MS)
    stop = with_own_doing(found, pause)
    assert (stop.reason, stop.values) == (reason, found.values)
    assert stop.detail.startswith(words)
    assert bool(stop.detail) == bool(words)
    assert ("link" in stop.sentence()) == (reason is StopReason.STATE_STALE)


def test_what_a_robot_does_about_a_process_that_was_silent_tells_of_the_silence() -> None:
    refused = Stop(StopReason.COMMAND_REFUSED, "STATUS_EXPIRED")
    told = with_own_doing(refused, Pause(1.0, 0.01, 0.0, ago_s=0.4))
    assert (told.reason, told.detail) == (
        StopReason.COMMAND_REFUSED,
        "STATUS_EXPIRED; 0.4 s before, this process did not run for 1 s",
    )
    assert with_own_doing(Stop(StopReason.TILT), Pause(1.0)).detail == "0.0 s before, this process did not run for 1 s"
    for pause in (Pause(0.0), Pause(1.0, 0.9, 0.0), Pause(1.0, 0.0, 0.9)):
        assert with_own_doing(refused, pause) is refused


def test_a_loop_that_did_not_look_has_paused_and_is_told_so_for_a_while(tmp_path: Path) -> None:
    now_s, used_s = [100.0], [5.0]
    watch = Pauses(CpuWait(tmp_path), lambda: now_s[0], lambda: used_s[0])

    def look(after_s: float, using_s: float = 0.0) -> float:
        now_s[0] += after_s
        used_s[0] += using_s
        return watch.look()

    assert (look(0.019), watch.recent, watch.waits()) == (0.0, None, Pause(0.0, 0.0, None))
    assert look(0.5, 0.01) == pytest.approx(0.5)
    assert watch.recent is not None
    assert watch.recent[:2] == pytest.approx((0.5, 0.01))
    assert look(0.03) == pytest.approx(0.03)
    assert watch.waits().duration_s == pytest.approx(0.5), "the longest counts"
    for _ in range(500):
        look(0.005)
    assert watch.recent is None


def test_a_process_that_was_stopped_says_so() -> None:
    code = "import sys, time; from spot_runtime.host.pauses import Pauses\nwatch = Pauses()\nprint(flush=True)"
    code += "\nwhile not watch.recent or not watch.recent.is_standstill: watch.look(); time.sleep(0.002)"
    code += "\nprint(watch.recent)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        process.send_signal(signal.SIGCONT)
        assert "Pause(duration_s=" in process.stdout.readline()


def test_the_wait_for_a_processor_is_that_of_the_thread_that_waited_longest(tmp_path: Path) -> None:
    def write(**waited_ns: int) -> None:
        for thread, ns in waited_ns.items():
            (tmp_path / thread).mkdir(exist_ok=True)
            (tmp_path / thread / "schedstat").write_text(f"123456789 {ns} 42\n")

    watch = CpuWait(tmp_path)
    assert watch.since_mark_s() is None
    write(t1=5_000_000, t2=900_000_000)
    assert watch.since_mark_s() is None, "nothing is marked yet"
    watch.mark()
    assert watch.since_mark_s() == 0.0
    write(t1=47_000_000, t2=910_000_000, t3=30_000_000)
    assert watch.since_mark_s() == pytest.approx(0.042)
    (tmp_path / "t1" / "schedstat").write_text("")  # a thread that is just ending
    assert watch.since_mark_s() == pytest.approx(0.030)
    assert CpuWait(tmp_path / "none").since_mark_s() is None


def test_a_kernel_that_does_not_count_waits_says_nothing_of_them(tmp_path: Path) -> None:
    for thread in ("t1", "t2"):
        (tmp_path / thread).mkdir()
        (tmp_path / thread / "schedstat").write_text("0 0 0\n")
    watch = CpuWait(tmp_path)
    watch.mark()
    assert watch.since_mark_s() is None


def test_the_echo_counts_where_the_policy_runs(dogs: Dogs, make_state: MakeState) -> None:
    dogs.screen([make_state(START_NS + 3 * i * MS) for i in range(101)], START_NS + 300 * MS)
    for mode in Mode:
        stops = look(dogs, mode, START_NS + 300 * MS, control_since_ns=START_NS)
        expected = [StopReason.COMMAND_UNCONFIRMED] if mode.runs_policy else []
        assert [s.reason for s in stops] == expected
    # An age that is a stop is told alone.
    stops = look(dogs, now_ns=START_NS + 350 * MS, control_since_ns=START_NS)
    assert [s.reason for s in stops] == [StopReason.STATE_STALE]


@pytest.mark.parametrize(
    ("mode", "reason", "detail"),
    [
        (Mode.READY, StopReason.STATE_LOST, "before joint control"),
        (Mode.ACTIVATING, StopReason.ACTIVATION_FAILED, "no answer"),
        (Mode.STANDING, StopReason.HAND_BACK_FAILED, "no answer"),
        (Mode.ACTIVE, None, ""),
        (Mode.DAMPING, None, ""),
    ],
)
def test_modes_that_must_end(dogs: Dogs, mode: Mode, reason: StopReason | None, detail: str) -> None:
    assert look(dogs, mode, START_NS + 3 * S, mode_since_ns=START_NS) == []
    stops = look(dogs, mode, START_NS + 3 * S + MS, mode_since_ns=START_NS)
    values = {"waited_s": 3.001, "bound_s": 3.0}
    assert stops == ([] if reason is None else [Stop(reason, detail, values)])


def test_a_robot_that_confirmed_joint_control_late_may_be_taken_hold_of(dogs: Dogs, robot: Any) -> None:
    for held_since_ns, is_late in ((0, True), (START_NS + 2900 * MS, False)):
        robot.now_ns = START_NS + 3200 * MS
        stops = dogs.look(Phase(Mode.ACTIVATING, START_NS, held_since_ns), robot.now_ns)
        assert [stop.reason for stop in stops] == [StopReason.ACTIVATION_FAILED] * is_late
    # Once it is handed back, the robot must answer that.
    (stop,) = dogs.look(Phase(Mode.STANDING, START_NS, START_NS), robot.now_ns)
    assert stop.reason is StopReason.HAND_BACK_FAILED


def test_the_log_is_asked_twice_a_second(dogs: Dogs, sink: SickSink) -> None:
    for ms in range(0, 1001, 3):
        look(dogs, now_ns=START_NS + ms * MS)
    assert sink.asked == 2
    look(dogs, now_ns=START_NS + 1002 * MS)
    assert sink.asked == 3


@pytest.mark.parametrize("stops_run", [False, True])
@pytest.mark.parametrize(("is_alive", "unwritten"), [(True, 0), (False, 0), (True, 3)])
def test_a_log_that_no_longer_records(robot: Any, stops_run: bool, is_alive: bool, unwritten: int) -> None:
    sink = SickSink()
    config = RunConfig.model_validate({"log": {"stop_on_failure": stops_run}})
    dogs = Dogs(robot, sink, config)
    is_well = is_alive and not unwritten
    sink.told = SinkHealth(is_alive, {}, {"state": unwritten, "event": 0}, "" if is_well else "disk full")
    stops = look(dogs)
    assert stops == ([Stop(StopReason.LOG_FAILED, "disk full")] if stops_run and not is_well else [])
    assert [e.name for e in sink.events] == ([] if is_well else ["log_problem"])


def test_lost_ticks_within_a_second(dogs: Dogs, sink: SickSink) -> None:
    assert dogs.lost_ticks(4, START_NS) is None
    assert dogs.lost_ticks(5, START_NS + S - 1) is None
    stop = dogs.lost_ticks(1, START_NS + S - 1)
    assert stop == Stop(StopReason.TICKS_SKIPPED, "", {"in_last_second": 10.0, "bound": 10.0})
    assert [(e.name, e.text, e.values) for e in sink.events] == [
        ("ticks_skipped", "4 policy ticks were lost", {"in_last_second": 4.0, "bound": 10.0})
    ]


def test_lost_ticks_of_more_than_a_second_ago_are_forgiven(dogs: Dogs) -> None:
    assert dogs.lost_ticks(9, START_NS) is None
    assert dogs.lost_ticks(9, START_NS + S) is None
    assert dogs.lost_ticks(1000, START_NS + 5 * S) is not None


def test_the_newest_state_is_the_last_that_may_be_used(dogs: Dogs, make_state: MakeState) -> None:
    assert (dogs.newest, dogs.missed_states) == (None, 0)
    state = make_state(START_NS)
    dogs.screen([state], START_NS)
    assert dogs.newest is state


def test_a_state_that_is_too_old_to_begin_with_is_named(dogs: Dogs, make_state: MakeState) -> None:
    late_ns = START_NS + 3 * S + MS
    dogs.screen([make_state(late_ns - 60 * MS)], late_ns)
    (stop,) = look(dogs, Mode.READY, late_ns, mode_since_ns=START_NS)
    assert (stop.reason, stop.detail) == (StopReason.STATE_STALE, "before joint control")
    assert stop.values["age_s"] == pytest.approx(0.06)
    dogs.screen([make_state(late_ns + 3 * MS)], late_ns + 3 * MS)
    (stop,) = look(dogs, Mode.READY, late_ns + 3 * MS, mode_since_ns=START_NS)
    assert (stop.reason, stop.detail) == (StopReason.ACTIVATION_FAILED, "it did not come to rest")


def test_a_battery_that_charges_while_the_robot_walks_ends_the_run(dogs: Dogs, robot: Any) -> None:
    reasons = []
    for second in range(14):
        now_ns = START_NS + second * S
        robot.slow = replace(robot.slow, battery_current_a=-5.0 if second < 2 else 5.0)
        reasons.append([stop.reason for stop in look(dogs, now_ns=now_ns)])
    assert reasons == [[]] * 12 + [[StopReason.BATTERY_UNKNOWN]] * 2
