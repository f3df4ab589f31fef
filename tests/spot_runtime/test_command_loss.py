"""Lost commands, told from confirmed keys: losses of a known share are found, jitter is none."""

from __future__ import annotations

import numpy as np
import pytest

from spot_runtime.command_loss import WINDOW_KEYS, LossMemory, confirm, loss_share


def after(keys: list[int]) -> LossMemory:
    memory = LossMemory()
    for key in keys:
        memory = confirm(memory, key)
    return memory


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4])
def test_the_share_is_found(share: float) -> None:
    rng = np.random.default_rng(5)
    n = 100
    shares = []
    for _ in range(n):
        arrived = [key for key in range(1, 4 * WINDOW_KEYS) if rng.random() >= share]
        shares.append(after(arrived).share)
    assert np.mean(shares) == pytest.approx(share, abs=0.02)


def test_two_commands_within_a_state_period_are_no_loss() -> None:
    keys = [key for key in range(1, 4 * WINDOW_KEYS) if key % 2]
    assert after(keys).share == 0.0
    assert after([key for key in range(1, 4 * WINDOW_KEYS) if key % 3 == 0]).share > 0.5


def test_nothing_is_said_before_a_window_is_full_and_old_keys_change_nothing() -> None:
    memory = after([10, 13, 16])
    assert (memory.first_key, memory.newest_key, memory.bursts, memory.share) == (10, 16, 2, 0.0)
    assert confirm(memory, 16) is memory
    assert confirm(memory, 3) is memory
    assert confirm(LossMemory(), 0) == LossMemory()
    full = confirm(memory, 10 + WINDOW_KEYS)
    assert (full.first_key, full.newest_key, full.bursts) == (10 + WINDOW_KEYS, 10 + WINDOW_KEYS, 0)
    assert full.share == pytest.approx(loss_share(3, WINDOW_KEYS))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.6])
def test_the_share_solves_its_equation(share: float) -> None:
    bursts = round(share * share * (1.0 - share) * 1_000_000)
    assert loss_share(bursts, 1_000_000) == pytest.approx(share, abs=2e-3)
    assert loss_share(200_000, 1_000_000) == pytest.approx(2.0 / 3.0)
