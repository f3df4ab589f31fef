"""Noise of a logged signal by the paper's spectral estimate."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def noise_sigma(samples: NDArray[Any]) -> NDArray[np.float64]:
    """Standard deviation of the white noise in evenly sampled signals.

    The spectrum is multiplied by frequency, so that motion, whose spectrum falls with frequency, weighs little, and
    its mean power over the upper half of the band is taken. The factor is normalised so that white noise of standard
    deviation σ gives σ.

    Args:
        samples: Shape (T, ...), at least 16 samples along the first axis; the rate does not matter.

    Returns:
        Shape (...), in the samples' unit.

    Raises:
        ValueError: There are fewer than 16 samples.

    Source: the paper, section on observation noise.
    """
    n = len(samples)
    if n < 16:
        raise ValueError(f"noise_sigma got {n} samples; at least 16 are needed")
    centred = np.asarray(samples, dtype=np.float64) - np.mean(samples, axis=0)
    spectrum = np.fft.rfft(centred, axis=0)
    frequency = np.fft.rfftfreq(n)
    upper = frequency >= 0.25
    weight = frequency[upper] / np.sqrt(np.mean(frequency[upper] ** 2))
    shape = (-1,) + (1,) * (centred.ndim - 1)
    power = np.mean(np.abs(spectrum[upper] * weight.reshape(shape)) ** 2, axis=0)
    return np.asarray(np.sqrt(power / n))
