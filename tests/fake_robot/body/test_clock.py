"""The robot's clock, with a host clock of our own."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from fake_robot.body.clock import RobotClock
from fake_robot.scenario.parts import ClockConfig

NS = 1_000_000_000


@dataclass
class Host:
    now_ns: int = 5 * NS
    unix_s: int = 1_000

    def monotonic_ns(self) -> int:
        return self.now_ns

    def unix_ns(self) -> int:
        return self.unix_s * NS


def clock_of(host: Host, *, is_lock_step: bool = False, **config: float) -> RobotClock:
    return RobotClock(
        ClockConfig(**config),
        is_lock_step=is_lock_step,
        host_monotonic_ns=host.monotonic_ns,
        host_unix_ns=host.unix_ns,
    )


def test_the_default_skew_is_that_of_the_recording():
    assert clock_of(Host()).now_ns() == 1_000 * NS - 199_190_000_000


def test_a_drifting_clock_gains_its_millionths():
    host = Host()
    clock = clock_of(host, skew_s=0.0, drift_ppm=50.0)
    clock.run()
    host.now_ns += 1_000 * NS
    # 50 ppm of 1000 s is 50 ms.
    assert clock.now_ns() == 2_000 * NS + 50_000_000


def test_waiting_times_are_host_times():
    host = Host()
    clock = clock_of(host, drift_ppm=10_000.0)
    clock.run()
    assert clock.host_seconds_until(NS) == pytest.approx(1.0 / 1.01)


def test_in_lock_step_the_host_clock_does_not_matter():
    host = Host()
    clock = clock_of(host, is_lock_step=True, skew_s=1.0)
    clock.run()
    host.now_ns += 77 * NS
    assert clock.now_ns() == 1_001 * NS
    clock.set_simulated_ns(3_000_000)
    assert clock.now_ns() == 1_001 * NS + 3_000_000


def test_a_jump_moves_stamps_and_not_elapsed_time():
    host = Host()
    clock = clock_of(host, skew_s=0.0)
    clock.run()
    clock.jump(-NS)
    assert (clock.now_ns(), clock.elapsed_ns()) == (999 * NS, 0)


def test_lost_time_stays_lost():
    host = Host()
    clock = clock_of(host, skew_s=0.0)
    clock.run()
    host.now_ns += 2 * NS
    clock.slip(NS)
    assert clock.elapsed_ns() == NS
    host.now_ns += NS
    assert clock.elapsed_ns() == 2 * NS


def test_a_fixed_start_makes_stamps_repeat():
    stamps = {clock_of(Host(), start_unix_s=1_700_000_000).now_ns() for _ in range(3)}
    assert stamps == {1_700_000_000 * NS - 199_190_000_000}


def test_the_skew_holds_from_the_moment_at_which_time_begins_to_run():
    host = Host()
    clock = clock_of(host, skew_s=1.0)
    host.unix_s += 3
    clock.run()
    assert clock.now_ns() == 1_004 * NS
