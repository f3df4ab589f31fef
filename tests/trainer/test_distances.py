"""The measures of the score: Wasserstein distances, the maximum mean discrepancy, and what a score makes of them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from numpy.typing import NDArray

from trainer.signals.distances import (
    BANDWIDTH_FACTORS,
    FourierFeatures,
    SequenceReference,
    embedding_distance,
    median_bandwidth,
    score_of_distances,
    wasserstein_sorted,
)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (7, 7), (5, 8), (12, 1), (100, 37)])
def test_wasserstein_distances_agree_with_scipys(n: int, m: int) -> None:
    rng = np.random.default_rng(n + m)
    first, second = np.sort(rng.standard_normal((2, 3, n))), np.sort(2.0 * rng.standard_normal((3, m)) + 0.5)
    found = wasserstein_sorted(first, second)
    wanted = [[scipy.stats.wasserstein_distance(a, b) for a, b in zip(row, second, strict=True)] for row in first]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_wasserstein_distance_worked_out_by_hand() -> None:
    # Half the mass of {0} moves to 0 (free) and half to 3: 1.5.
    assert wasserstein_sorted(np.array([0.0]), np.array([0.0, 3.0])) == pytest.approx(1.5)


def mmd_exact(first: np.ndarray, second: np.ndarray, bandwidth: float) -> float:
    """MMD by the kernel's full matrices: Gretton et al. 2012, A Kernel Two-Sample Test, equation 5."""

    def kernel(a: np.ndarray, b: np.ndarray) -> float:
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
        return float(np.mean([np.exp(-squared / (2.0 * (s * bandwidth) ** 2)) for s in BANDWIDTH_FACTORS]))

    return float(np.sqrt(max(kernel(first, first) + kernel(second, second) - 2.0 * kernel(first, second), 0.0)))


@pytest.mark.parametrize("shift", [0.3, 1.0])
def test_fourier_features_come_close_to_the_exact_discrepancy(shift: float) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((300, 36)), rng.standard_normal((250, 36)) + shift
    bandwidth = median_bandwidth(x)
    features = FourierFeatures.draw(np.random.default_rng(2), 36, 192, bandwidth)
    fast = float(embedding_distance(features.mean_embedding(x), features.mean_embedding(y)))
    assert fast == pytest.approx(mmd_exact(x, y, bandwidth), rel=0.1)


def test_the_bandwidth_is_the_median_distance_of_samples_that_differ() -> None:
    # Distances 1, 2 and 3.
    assert median_bandwidth(np.array([[0.0], [1.0], [3.0]])) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="no median distance above 0"):
        median_bandwidth(np.ones((10, 2)))
    with pytest.raises(ValueError, match="multiple of 3"):
        FourierFeatures.draw(np.random.default_rng(0), 2, 100, 1.0)


def runs(n: int, shift: float = 0.0, seed: int = 0) -> list[NDArray[np.float32]]:
    rng = np.random.default_rng(seed)
    return [(rng.standard_normal((200, 36)) + shift).astype(np.float32) for _ in range(n)]


def test_a_run_of_the_same_process_scores_one_and_others_more() -> None:
    reference = SequenceReference.build("a", runs(6))

    def score(some: list[NDArray[np.float32]]) -> float:
        return float(score_of_distances(np.stack([reference.distances(f) for f in some]), reference.scale))

    assert score(runs(6, seed=1)) == pytest.approx(1.0, abs=0.05)
    assert 1.0 < score(runs(1, 0.2, 1)) < score(runs(1, 1.0, 1))


def test_the_floor_is_the_mean_over_pairs_of_different_runs() -> None:
    reference = SequenceReference.build("a", runs(3))
    pairs = reference.pair_distances
    assert reference.floor == pytest.approx((pairs[0, 1] + pairs[0, 2] + pairs[1, 2]) / 3.0)
    assert np.all(pairs[np.arange(3), np.arange(3)] == 0.0)
    alone = SequenceReference.build("a", runs(1))
    assert alone.floor is None
    assert np.all(alone.scale > 0.0)


def test_many_runs_at_once_are_as_far_as_one_by_one() -> None:
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng(3)
    reference = SequenceReference.build("walk", [rng.normal(0.0, 9.0, (n, 36)).astype(np.float32) for n in (90, 80)])
    simulated = rng.normal(1.0, 8.0, (3, 80, 36)).astype(np.float32)
    simulated[2, 40] = np.nan
    one_by_one = np.array([reference.distances(run) for run in simulated])
    assert np.isnan(one_by_one).any(axis=(1, 2)).tolist() == [False, False, True]
    np.testing.assert_allclose(reference.distances_of_many(torch.from_numpy(simulated)), one_by_one, rtol=1e-4)
