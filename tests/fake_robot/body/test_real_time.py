"""Robot time on a host clock of our own: catching up, and giving up what is too far behind."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import pytest

from fake_robot.body.clock import RobotClock
from fake_robot.robot.real_time import RealTimeLoop
from fake_robot.robot.simulation import Simulation
from fake_robot.scenario.parts import ClockConfig
from fake_robot.scenario.scenario import Scenario

MS = 1_000_000


@dataclass
class Host:
    now_ns: int = 0

    def monotonic_ns(self) -> int:
        return self.now_ns


class Bench:
    def __init__(self) -> None:
        self.host = Host()
        self.clock = RobotClock(
            ClockConfig(start_unix_s=1), is_lock_step=False, host_monotonic_ns=self.host.monotonic_ns
        )
        self.delivered: list[int] = []
        self.simulation = Simulation(Scenario(), self.clock, lambda stamp, _: self.delivered.append(stamp))
        self.loop = RealTimeLoop(
            self.simulation,
            self.clock,
            threading.Condition(threading.RLock()),
            max_catch_up_s=0.25,
            on_crash=lambda: None,
        )
        self.clock.run()

    def wake_until_idle(self) -> None:
        """Wake until nothing is due: neither time nor deliveries move any more."""
        while True:
            before = (self.simulation.now_ns, len(self.delivered))
            self.loop.wake()
            if (self.simulation.now_ns, len(self.delivered)) == before:
                return


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_the_simulation_is_never_ahead_of_the_clock(bench: Bench):
    for now_ms in (1, 2, 3, 4, 7, 9, 20):
        bench.host.now_ns = now_ms * MS
        bench.wake_until_idle()
        assert bench.simulation.now_ns == now_ms * MS // (3 * MS) * 3 * MS


def test_states_are_delivered_at_their_arrival_and_not_before(bench: Bench):
    bench.host.now_ns = 3 * MS
    bench.wake_until_idle()
    assert bench.delivered == []
    arrival_ns = bench.simulation.next_arrival_ns
    assert arrival_ns is not None
    assert 3 * MS < arrival_ns < 6 * MS
    bench.host.now_ns = arrival_ns - 1000
    bench.wake_until_idle()
    assert bench.delivered == []
    bench.host.now_ns = arrival_ns
    bench.wake_until_idle()
    assert len(bench.delivered) == 1


def test_a_short_stall_is_caught_up_without_loss(bench: Bench):
    bench.host.now_ns = 200 * MS
    bench.wake_until_idle()
    assert bench.simulation.now_ns == 198 * MS
    assert bench.loop.lost_ns == 0
    assert len(bench.delivered) >= 64


def test_after_a_long_stall_the_robot_clock_is_late_and_stays_so(bench: Bench):
    bench.host.now_ns = 2_000 * MS
    bench.wake_until_idle()
    # Due at 3 ms, woken at 2000 ms: of 1997 ms of lateness 250 ms are caught up.
    assert bench.loop.lost_ns * 1e-9 == pytest.approx(1.747)
    assert bench.clock.elapsed_ns() == 253 * MS
    assert bench.simulation.now_ns == 252 * MS
    bench.host.now_ns += 30 * MS
    bench.wake_until_idle()
    assert bench.clock.elapsed_ns() == 283 * MS
    assert bench.loop.lost_ns * 1e-9 == pytest.approx(1.747)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_crash_of_the_thread_is_kept_and_reported():
    bench = Bench()
    crashed = threading.Event()
    simulation = bench.simulation

    class BrokenClock(RobotClock):
        def host_seconds_until(self, elapsed_ns: int) -> float:
            raise RuntimeError("broken")

    clock = BrokenClock(ClockConfig(), is_lock_step=False)
    loop = RealTimeLoop(
        simulation, clock, threading.Condition(threading.RLock()), max_catch_up_s=0.25, on_crash=crashed.set
    )
    loop.start()
    assert crashed.wait(30.0)
    loop.stop()
    assert str(loop.crash) == "broken"


def test_lost_time_is_told_once_when_it_begins_and_in_all_at_the_end(bench: Bench, caplog: pytest.LogCaptureFixture):
    bench.host.now_ns = 2_000 * MS
    bench.wake_until_idle()
    bench.host.now_ns += 1_000 * MS
    bench.wake_until_idle()
    (told,) = [record.getMessage() for record in caplog.records]
    assert "1747 ms of robot time are lost" in told
    bench.loop.stop()
    assert caplog.records[-1].getMessage() == f"in all, {bench.loop.lost_ns * 1e-9:.2f} s of robot time were lost"
