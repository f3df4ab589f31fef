"""Lost commands, told from confirmed keys: losses of a known share are found, jitter is none."""

from __future__ import annotations

import numpy as np
import pytest

from spot_runtime.control.safety.watchdogs import WINDOW_KEYS, LossMemory, confirm, loss_share


def after(keys: list[int]) -> LossMemory:
    memory = LossMemory()
    for key in keys:
        memory = confirm(memory, key)
    return memory


@pytest.mark.parametrize("share", [0.2, 0.4])
def test_the_share_is_found(share: float) -> None:
    rng = np.random.default_rng(5)
    shares = []
    for _ in range(40):
        arrived = np.flatnonzero(rng.random(2 * WINDOW_KEYS) >= share)
        shares.append(after([int(key) for key in arrived if key > 0]).share)
    assert np.mean(shares) == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("step", [1, 2, 3])
def test_a_few_commands_within_a_state_period_are_no_loss(step: int) -> None:
    assert after(list(range(1, 4 * WINDOW_KEYS, step))).share == 0.0


def test_three_in_a_row_are() -> None:
    assert after(list(range(1, 4 * WINDOW_KEYS, 4))).share > 0.7


def test_nothing_is_said_before_a_window_is_full_and_the_same_key_changes_nothing() -> None:
    memory = after([10, 14, 18, 21])
    assert memory == LossMemory(10, 21, 2, 0.0)
    assert confirm(memory, 21) == memory
    nearly = confirm(memory, 10 + WINDOW_KEYS - 1)
    assert nearly == LossMemory(10, 10 + WINDOW_KEYS - 1, 3, 0.0)
    full = confirm(nearly, 10 + WINDOW_KEYS)
    assert full == LossMemory(10 + WINDOW_KEYS, 10 + WINDOW_KEYS, 0, loss_share(3, WINDOW_KEYS))
    assert confirm(full, full.newest_key + 1).share == full.share


def test_the_echo_of_an_earlier_run_begins_nothing() -> None:
    assert confirm(LossMemory(), 0) == LossMemory()
    assert after([5000, 5000, 1, 2]) == LossMemory(1, 2)
    assert after([5000, 4999]) == LossMemory(4999, 4999)


@pytest.mark.parametrize("share", [0.05, 0.1, 0.3, 0.6])
def test_the_share_solves_its_equation(share: float) -> None:
    bursts = round(share**3 * (1.0 - share) * 1_000_000)
    assert loss_share(bursts, 1_000_000) == pytest.approx(share, abs=1e-3)
    assert loss_share(0, 1000) == 0.0
    assert loss_share(1000, 1000) == pytest.approx(0.75, abs=2e-4)
