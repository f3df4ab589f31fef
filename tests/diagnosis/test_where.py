import numpy as np
import pytest

from diagnosis.closed_loop.gap_map import benjamini_hochberg


def test_adjusted_p_values_by_hand() -> None:
    # Sorted 0.01, 0.02, 0.03, 0.5 times 4/1, 4/2, 4/3, 4/4 = 0.04, 0.04, 0.04, 0.5.
    found = benjamini_hochberg(np.array([0.5, 0.01, 0.03, 0.02]))
    np.testing.assert_allclose(found, [0.5, 0.04, 0.04, 0.04])


def test_adjusted_p_values_are_monotone_and_at_most_one() -> None:
    p = np.random.default_rng(0).uniform(size=200)
    found = benjamini_hochberg(p)
    assert found.max() <= 1.0
    assert np.all(found >= p - 1e-12)
    assert np.all(np.diff(found[np.argsort(p)]) >= 0.0)


def test_few_discoveries_among_noise() -> None:
    p = np.random.default_rng(1).uniform(size=1000)
    assert (benjamini_hochberg(p) < 0.05).sum() == pytest.approx(0, abs=2)
