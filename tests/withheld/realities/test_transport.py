"""Commands on their way."""

from __future__ import annotations

import numpy as np
import pytest

from withheld.realities.fault_kind import Ask, flags_of
from withheld.realities.calibrating import transport as faults
from withheld.simulator.robot import Robot
from withheld.simulator.simulation import tick_states
from withheld.simulator.recording.transport import MEAN_DELAY_S, NEVER_NS, Deliveries, deliveries

PERIOD_NS = 3_000_000


def sent(draw: object = None, size: float = 1.0, n: int = 20_000) -> tuple[Deliveries, dict[str, float]]:
    robot = Robot()
    parameters: dict[str, float] = {}
    if callable(draw):
        built = draw(Ask(np.random.default_rng(1), size, flags_of(())))
        built.install(robot)
        parameters = dict(built.parameters)
    return deliveries(n, robot.delays, np.random.default_rng(0)), parameters


def delays_s(way: Deliveries) -> np.ndarray:
    arrived = way.arrival_ns < NEVER_NS
    return np.asarray((way.arrival_ns - PERIOD_NS * np.arange(len(way.arrival_ns)))[arrived] * 1e-9)


def test_the_nominal_delay_is_the_mean_and_nothing_overtakes() -> None:
    way, _ = sent()
    assert delays_s(way).mean() == pytest.approx(MEAN_DELAY_S, rel=0.01)
    assert 1e-4 < delays_s(way).std() < 5e-4
    assert np.all(np.diff(way.arrival_ns) >= 0)


def test_a_queue_adds_its_mean() -> None:
    way, stated = sent(faults.delay, 0.5)
    assert delays_s(way).mean() - MEAN_DELAY_S == pytest.approx(stated["command_delay.delay_s"], rel=0.03)


def test_a_stutter_spreads_the_delays() -> None:
    calm, _ = sent()
    way, stated = sent(faults.jitter)
    # Commands wait for those before them, so the mean is a little over the draw's.
    assert delays_s(way).mean() - MEAN_DELAY_S >= 0.95 * stated["command_jitter.mean_s"]
    assert delays_s(way).std() > 5.0 * delays_s(calm).std()


def test_a_lossy_link_loses_its_share_in_bursts() -> None:
    way, stated = sent(faults.losses)
    lost = way.arrival_ns == NEVER_NS
    assert lost.mean() == pytest.approx(stated["command_drop.probability"], rel=0.1)
    assert lost[1:][lost[:-1]].mean() > 3.0 * lost.mean()


def test_the_newest_arrival_is_in_effect_and_lost_ones_never_are() -> None:
    way = Deliveries(np.zeros(4, dtype=np.int64), np.zeros(4, dtype=np.int64), np.array([5, NEVER_NS, 9, 9]))
    assert way.newest(np.array([0, 4, 5, 8, 9, 100])).tolist() == [-1, -1, 0, 0, 3, 3]


def test_the_policy_runs_at_fifty_hertz_of_stamps() -> None:
    ticks = tick_states(2001)
    assert ticks[:7].tolist() == [0, 7, 14, 20, 27, 34, 40]
    assert len(ticks) == 301
