"""A channel delays whole messages, keeps their order, and loses some."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fake_robot.network.streams import ChannelFault, DelayLine
from fake_robot.scenario.parts import COMMAND_CHANNEL, STATE_CHANNEL, ChannelConfig
from spot_model.plant.delay import ConstantDelay, GammaDelay

MS = 1_000_000


def channel(seed: int = 0, **config: object) -> DelayLine[int]:
    return DelayLine(ChannelConfig(**config), np.random.default_rng(seed))


def test_a_constant_delay_is_exact():
    line = channel(delay=ConstantDelay(delay_s=0.004))
    line.send(1, 10 * MS)
    assert line.receive(14 * MS - 1) == []
    assert line.receive(14 * MS) == [(14 * MS, 10 * MS, 1)]
    assert line.receive(99 * MS) == []


@given(seed=st.integers(0, 1000), gaps=st.lists(st.integers(0, 5 * MS), min_size=2, max_size=60))
def test_no_message_overtakes_another(seed: int, gaps: list[int]):
    line = channel(seed, delay=GammaDelay(shape=0.5, scale_s=0.01))
    now = 0
    for number, gap in enumerate(gaps):
        now += gap
        line.send(number, now)
    received = line.receive(10**12)
    assert [message for _, _, message in received] == list(range(len(gaps)))
    arrivals = [arrival for arrival, _, _ in received]
    assert arrivals == sorted(arrivals)
    assert all(arrival >= sent for arrival, sent, _ in received)


def test_an_arrival_is_the_later_of_its_own_and_the_one_before():
    line = channel(delay=ConstantDelay(delay_s=0.001))
    line.fault = ChannelFault(delay_s=0.009)
    line.send(1, 0)
    line.fault = ChannelFault()
    line.send(2, 3 * MS)
    line.send(3, 12 * MS)
    assert [arrival for arrival, _, _ in line.receive(10**12)] == [10 * MS, 10 * MS, 13 * MS]


def test_drops_have_their_probability():
    line = channel(delay=ConstantDelay(delay_s=0.0), drop_probability=0.2)
    for number in range(5000):
        line.send(number, number)
    assert len(line.receive(10**9)) / 5000 == pytest.approx(0.8, abs=0.02)


def test_a_drop_fault_adds_to_the_drops_of_the_channel():
    line = channel(delay=ConstantDelay(delay_s=0.0))
    line.fault = ChannelFault(drop_probability=1.0)
    line.send(1, 0)
    assert line.receive(10**9) == []


def test_a_jitter_fault_delays_by_its_mean():
    line = channel(delay=ConstantDelay(delay_s=0.0))
    line.fault = ChannelFault(jitter_s=0.003)
    for number in range(3000):
        line.send(number, number * 10**9)
    delays = [arrival - sent for arrival, sent, _ in line.receive(10**15)]
    assert np.mean(delays) == pytest.approx(3 * MS, rel=0.06)


def test_the_same_seed_draws_the_same_delays():
    def arrivals(seed: int) -> list[int]:
        line = channel(seed, delay=GammaDelay(shape=2.0, scale_s=0.002), drop_probability=0.1)
        for number in range(1200):
            line.send(number, number * 20 * MS)
        return [arrival for arrival, _, _ in line.receive(10**15)]

    assert arrivals(3) == arrivals(3)
    assert arrivals(3) != arrivals(4)


def test_default_channels_add_up_to_the_recorded_delay():
    rng = np.random.default_rng(0)
    total = STATE_CHANNEL.delay.sample(rng, 50_000) + COMMAND_CHANNEL.delay.sample(rng, 50_000)
    assert 0.004 < np.median(total) < 0.005
    # In the recording the state age's 99th percentile lies 0.96 ms above its median.
    assert np.percentile(total, 99) - np.median(total) == pytest.approx(0.00096, abs=0.0002)
