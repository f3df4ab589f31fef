from __future__ import annotations

import numpy as np
import pytest

from trainer.signals.distances import (
    BANDWIDTH_FACTORS,
    FourierFeatures,
    embedding_distance,
    median_bandwidth,
)


def mmd_exact(first: np.ndarray, second: np.ndarray, bandwidth: float) -> float:
    """MMD by the kernel's full matrices: Gretton et al. 2012, A Kernel Two-Sample Test, equation 5."""

    def kernel(a: np.ndarray, b: np.ndarray) -> float:
        squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
        return float(np.mean([np.exp(-squared / (2.0 * (s * bandwidth) ** 2)) for s in BANDWIDTH_FACTORS]))

    return float(np.sqrt(max(kernel(first, first) + kernel(second, second) - 2.0 * kernel(first, second), 0.0)))


def test_worked_out_by_hand() -> None:
    # One sample each, one unit apart, h = 1: MMD² = 2 − 2 k, k the mean of exp(−1/(2 s²)).
    kernel = np.mean([np.exp(-1.0 / (2.0 * s**2)) for s in BANDWIDTH_FACTORS])
    assert mmd_exact(np.zeros((1, 1)), np.ones((1, 1)), 1.0) == pytest.approx(np.sqrt(2.0 - 2.0 * kernel))


def test_equal_samples_have_none_and_far_ones_the_most() -> None:
    x = np.random.default_rng(0).standard_normal((40, 3))
    assert mmd_exact(x, x, 1.0) == pytest.approx(0.0, abs=1e-7)
    one = np.zeros((1, 3))
    assert mmd_exact(one, one + 1e3, 1.0) == pytest.approx(np.sqrt(2.0))


@pytest.mark.parametrize("shift", [0.3, 1.0])
def test_fourier_features_come_close_to_the_exact_distance(shift: float) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((300, 36)), rng.standard_normal((250, 36)) + shift
    bandwidth = median_bandwidth(x)
    features = FourierFeatures.draw(np.random.default_rng(2), 36, 192, bandwidth)
    fast = float(embedding_distance(features.mean_embedding(x), features.mean_embedding(y)))
    assert fast == pytest.approx(mmd_exact(x, y, bandwidth), rel=0.1)


def test_bandwidth_is_the_median_distance() -> None:
    # Distances 1, 2 and 3.
    assert median_bandwidth(np.array([[0.0], [1.0], [3.0]])) == pytest.approx(2.0)


def test_samples_without_spread_are_refused() -> None:
    with pytest.raises(ValueError, match="no median distance above 0"):
        median_bandwidth(np.ones((10, 2)))


def test_number_of_frequencies_fits_the_mixture() -> None:
    with pytest.raises(ValueError, match="multiple of 3"):
        FourierFeatures.draw(np.random.default_rng(0), 2, 100, 1.0)
