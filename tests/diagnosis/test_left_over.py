"""What the best set of effects leaves, against what robots without a fault leave."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.decision_constants import ODD_EXCESS, ORDINARY_EXCESS
from diagnosis.verdict.probability import excess, is_odd

LOAD, WRENCH = Channel.SET_POINT_TO_LOAD, Channel.BASE_WRENCH


def _board() -> Any:
    return SimpleNamespace(
        by_channel={LOAD: [0, 1], WRENCH: [2], Channel.BATTERY_POWER: [3]},
        tolerance_square=np.array([3.0, 3.0, 0.0, 0.0]),
        relative_square=np.array([0.25, 0.25, 0.0, 0.0]),
    )


def test_the_signal_that_is_farthest_over_noise_and_formulas_counts() -> None:
    scored: Any = SimpleNamespace(held_out=np.array([8.0, 40.0, 0.5, 1e6]), explained=np.array([0.0, 64.0, 0.0, 0.0]))
    # 8 of 1 + 3; 40 of 1 + 3 + 64/4; the battery is not checked.
    assert excess(_board(), scored) == pytest.approx({LOAD: np.log(2.0), WRENCH: np.log(0.5)})


def test_a_signal_that_is_explained_to_the_bit_is_not_odd() -> None:
    scored: Any = SimpleNamespace(held_out=np.zeros(4), explained=np.zeros(4))
    assert is_odd(excess(_board(), scored)) < 0.01


@pytest.mark.parametrize("channel", ORDINARY_EXCESS)
def test_what_robots_without_a_fault_leave_is_not_odd_and_far_more_is(channel: Channel) -> None:
    median, spread = ORDINARY_EXCESS[channel]
    even, _ = ODD_EXCESS
    assert is_odd({channel: median}) < 0.01
    assert is_odd({channel: median + even * spread}) == pytest.approx(0.5)
    assert is_odd({channel: median + 2.0 * even * spread}) > 0.99


def test_one_odd_signal_is_enough_and_without_signals_nothing_is_odd() -> None:
    usual = {channel: median for channel, (median, _) in ORDINARY_EXCESS.items()}
    assert is_odd(usual | {WRENCH: 5.0}) > 0.99 > 0.01 > is_odd(usual)
    assert is_odd({}) == 0.0
