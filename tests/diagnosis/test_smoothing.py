import numpy as np
import pytest

from trainer.signals.smoothing import NOISE_GAIN, REACH, eroded, rate, rate_over, smooth

PERIOD_S = 0.003


@pytest.mark.parametrize("frequency_hz", [1.0, 10.0, 25.0, 40.0, 60.0])
def test_rate_is_the_derivative_of_what_smooth_lets_through(frequency_hz):
    time_s = np.arange(600) * PERIOD_S
    turn = 2.0 * np.pi * frequency_hz
    inner = slice(20, -20)
    expected = smooth(turn * np.cos(turn * time_s))[inner]
    found = rate(np.sin(turn * time_s), PERIOD_S)[inner]
    assert np.max(np.abs(found - expected)) < 2e-3 * turn


def test_constants_and_lines_keep_their_value_and_slope():
    line = 3.0 + 2.0 * np.arange(50) * PERIOD_S
    assert smooth(line)[20] == pytest.approx(line[20])
    assert rate(line, PERIOD_S)[20] == pytest.approx(2.0, rel=2e-4)


def test_noise_gain_is_that_of_white_noise():
    noise = np.random.default_rng(0).standard_normal((200_000, 1))
    assert float(np.std(smooth(noise))) == pytest.approx(NOISE_GAIN, rel=0.02)


def test_erosion_by_hand():
    flags = np.ones(12, dtype=bool)
    flags[5] = False
    assert eroded(flags, 2, 1).astype(int).tolist() == [0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1, 0]


def test_a_smoothed_value_depends_on_its_reach_alone():
    signal = np.zeros(40)
    signal[20] = 1.0
    touched = np.flatnonzero((smooth(signal) != 0.0) | (rate(signal, 1.0) != 0.0))
    assert touched.min() >= 20 - REACH
    assert touched.max() <= 20 + REACH


def test_some_rows_are_filtered_as_all_are() -> None:
    signal = np.random.default_rng(3).normal(size=(101, 2))
    for rows in (slice(None, None, 5), np.array([0, 1, 50, 99, 100])):
        np.testing.assert_allclose(smooth(signal, rows), smooth(signal)[rows], atol=1e-12)
        np.testing.assert_allclose(rate(signal, 0.003, rows), rate(signal, 0.003)[rows], atol=1e-9)


def test_uneven_rows_have_the_derivative_of_their_instants():
    stamps_ns = np.cumsum(np.random.default_rng(1).choice([15, 18, 21], 400)) * 1_000_000
    turn, time_s = 2.0 * np.pi * 5.0, stamps_ns * 1e-9
    expected = smooth(turn * np.cos(turn * time_s))[20:-20]
    wrong = rate(np.sin(turn * time_s), 0.018)[20:-20]
    found = rate_over(np.sin(turn * time_s), stamps_ns)[20:-20]
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.1 * np.sqrt(np.mean((wrong - expected) ** 2))


def test_even_rows_have_the_kernels_own_derivative():
    stamps_ns = np.arange(100) * 3_000_000 + 17
    signal = np.sin(0.1 * np.arange(100))
    np.testing.assert_array_equal(rate_over(signal, stamps_ns), rate(signal, PERIOD_S))
