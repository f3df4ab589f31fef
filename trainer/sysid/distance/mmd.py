"""Maximum Mean Discrepancy with a Gaussian mixture kernel, by random Fourier features.

k(x, y) = mean over s in BANDWIDTH_FACTORS of exp(−‖x − y‖² / (2 (s h)²)), with the bandwidth h the median distance
between two samples of the real data. MMD² is the biased estimate (V-statistic): ‖mean φ(x) − mean φ(y)‖² ≥ 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

BANDWIDTH_FACTORS: Final = (0.5, 1.0, 2.0)
"""Multiples of the median distance whose kernels are averaged."""

MEDIAN_SAMPLES: Final = 1000
"""At most so many samples, evenly spaced, go into the median."""


def median_bandwidth(samples: NDArray[Any]) -> float:
    """Median distance between two different samples, shape (n, d); of evenly spaced ones where there are many.

    Raises:
        ValueError: Fewer than two samples, or most of them are equal: there is no scale.
    """
    step = -(-len(samples) // MEDIAN_SAMPLES)
    few = np.asarray(samples[::step], dtype=np.float64)
    upper = np.triu_indices(len(few), k=1)
    distances = np.sqrt(_squared_distances(few, few)[upper])
    if not distances.size or not np.median(distances) > 0.0:
        raise ValueError(f"{len(samples)} samples of shape {samples.shape[1:]} have no median distance above 0")
    return float(np.median(distances))


@dataclass(frozen=True)
class FourierFeatures:
    """A random map φ with φ(x)·φ(y) ≈ k(x, y), so that the MMD is a distance between means.

    Source: Rahimi and Recht 2007, Random Features for Large-Scale Kernel Machines.
    """

    frequencies: NDArray[np.float32]
    """Shape (d, n_frequencies), radians over the samples' unit."""

    @staticmethod
    def draw(rng: np.random.Generator, n_dimensions: int, n_frequencies: int, bandwidth: float) -> FourierFeatures:
        """Draw frequencies, equally many for each kernel of the mixture.

        Raises:
            ValueError: ``n_frequencies`` is not a multiple of the number of kernels.
        """
        n_kernels = len(BANDWIDTH_FACTORS)
        if n_frequencies < n_kernels or n_frequencies % n_kernels:
            raise ValueError(f"n_frequencies = {n_frequencies}; allowed: a multiple of {n_kernels}")
        scale = np.repeat(1.0 / (np.array(BANDWIDTH_FACTORS) * bandwidth), n_frequencies // n_kernels)
        return FourierFeatures((rng.standard_normal((n_dimensions, n_frequencies)) * scale).astype(np.float32))

    def mean_embedding(self, samples: NDArray[Any]) -> NDArray[np.float64]:
        """Mean of φ over samples of shape (n, d); shape (2 n_frequencies,)."""
        phase = np.asarray(samples, dtype=np.float32) @ self.frequencies
        means = [np.mean(wave(phase), axis=0, dtype=np.float64) for wave in (np.cos, np.sin)]
        return np.asarray(np.concatenate(means) / np.sqrt(self.frequencies.shape[1]))


def embedding_distance(first: NDArray[Any], second: NDArray[Any]) -> NDArray[np.float64]:
    """MMD of two mean embeddings, along the last axis."""
    return np.asarray(np.linalg.norm(first - second, axis=-1))


def _squared_distances(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    squared = (first**2).sum(axis=1)[:, None] + (second**2).sum(axis=1)[None, :] - 2.0 * (first @ second.T)
    return np.asarray(np.maximum(squared, 0.0))
