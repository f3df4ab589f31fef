import numpy as np
import pytest

from trainer.sysid.logs.noise_estimate import noise_sigma


def test_white_noise_gives_its_own_deviation() -> None:
    samples = np.random.default_rng(0).normal(0.0, [0.3, 0.02], (20000, 2))
    np.testing.assert_allclose(noise_sigma(samples), [0.3, 0.02], rtol=0.03)


def test_slow_motion_under_the_noise_weighs_little() -> None:
    rng, t = np.random.default_rng(1), np.arange(5000) / 50.0
    walk = 0.5 * np.sin(2 * np.pi * 2.0 * t) + 0.2 * np.sin(2 * np.pi * 4.0 * t)
    sigma = noise_sigma(walk + rng.normal(0.0, 0.05, t.shape))
    assert float(sigma) == pytest.approx(0.05, rel=0.1)


def test_too_short_a_log_is_refused() -> None:
    with pytest.raises(ValueError, match="got 15 samples; at least 16"):
        noise_sigma(np.zeros(15))
