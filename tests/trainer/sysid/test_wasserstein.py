from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from trainer.signals.distances import wasserstein_sorted


def wasserstein_1d(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return wasserstein_sorted(np.sort(first, axis=-1), np.sort(second, axis=-1))


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


def least_cost_of_transport(first: np.ndarray, second: np.ndarray) -> float:
    """The distance by its definition: the cheapest plan that moves equal masses, a linear programme."""
    n, m = len(first), len(second)
    leaves = np.kron(np.eye(n), np.ones(m))
    arrives = np.kron(np.ones(n), np.eye(m))
    cost = np.abs(first[:, None] - second[None, :]).ravel()
    masses = np.concatenate([np.full(n, 1.0 / n), np.full(m, 1.0 / m)])
    found = scipy.optimize.linprog(cost, A_eq=np.vstack([leaves, arrives]), b_eq=masses, method="highs")
    assert found.status == 0
    return float(found.fun)


def test_it_is_the_cheapest_plan_of_transport() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.standard_normal(12), rng.standard_normal(9) - 0.4
    assert wasserstein_1d(first, second) == pytest.approx(least_cost_of_transport(first, second), rel=1e-9)
