from __future__ import annotations

import numpy as np
import ot
import pytest
import scipy.stats

from trainer.sysid.distance.wasserstein import sliced_wasserstein, unit_directions, wasserstein_1d, wasserstein_sorted


@pytest.mark.parametrize(("n", "m"), [(1, 1), (7, 7), (5, 8), (12, 1), (100, 37)])
def test_agrees_with_scipy(n: int, m: int) -> None:
    rng = np.random.default_rng(n + m)
    first, second = rng.standard_normal(n), 2.0 * rng.standard_normal(m) + 0.5
    assert wasserstein_1d(first, second) == pytest.approx(scipy.stats.wasserstein_distance(first, second), rel=1e-12)


def test_works_on_many_at_once() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((3, 4, 50)), rng.standard_normal((4, 20))
    found = wasserstein_1d(first, second)
    assert found.shape == (3, 4)
    assert found[2, 1] == pytest.approx(scipy.stats.wasserstein_distance(first[2, 1], second[1]))


def test_a_shift_costs_its_size() -> None:
    samples = np.sort(np.random.default_rng(1).standard_normal(30))
    assert wasserstein_sorted(samples, samples + 0.7) == pytest.approx(0.7)
    assert wasserstein_sorted(samples, samples) == 0.0


def test_worked_out_by_hand() -> None:
    # Half the mass of {0} moves to 0 (free) and half to 3: 1.5.
    assert wasserstein_1d(np.array([0.0]), np.array([3.0, 0.0])) == pytest.approx(1.5)


def test_sliced_agrees_with_pot() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.standard_normal((80, 5)), rng.standard_normal((60, 5)) + 0.3
    directions = unit_directions(rng, 20, 5)
    expected = ot.sliced_wasserstein_distance(first, second, projections=directions.T, p=1)
    assert sliced_wasserstein(first, second, directions) == pytest.approx(float(expected), rel=1e-9)
