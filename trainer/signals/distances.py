"""Features of runs, and how far simulated runs lie from real ones: the paper's two measures on pairs of runs.

The first is the Wasserstein distance of each feature. The second is the Maximum Mean Discrepancy with a Gaussian
mixture kernel, by random Fourier features: k(x, y) = mean over s in BANDWIDTH_FACTORS of exp(−‖x − y‖² / (2 (s h)²)),
with the bandwidth h the median distance between two samples of the real data. MMD² is the biased estimate
(V-statistic): ‖mean φ(x) − mean φ(y)‖² ≥ 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run
from spot_model.policy.observation import observed
from spot_model.policy.policy import Policy
from spot_model.robot.arrays import like, namespace_of, on_host
from spot_model.robot.facts import Array
from spot_model.robot.rotation import AnyArray
from trainer.signals.policy_ticks import policy_ticks


def features_of_observations(observation: AnyArray, action: AnyArray, policy: Policy) -> Any:
    """Joint position scaled by kp, velocity by kd, and action by σ_a·kp.

    Args:
        observation: Shape (..., 48), as :mod:`spot_model.policy.observation` lays it out, policy order.
        action: The network's output. Shape (..., 12), policy order.
        policy: The policy that ran: gains, action scale, joint order, default pose.

    Returns:
        Shape (..., 36), canonical order, float32, N·m; of the array library of ``observation``.

    Source: the paper, footnote on the feature space of the evaluation metrics.
    """
    contract, order = policy.contract, policy.canonical_from_policy.tolist()
    exact = np.asarray(observation, dtype=np.float64) if isinstance(observation, np.ndarray) else observation
    position = observed(exact, "joint_position_offset_rad") + like(exact, policy.default_position_rad)
    velocity = observed(exact, "joint_velocity_rad_s")
    kp = like(exact, np.array(contract.kp_nm_per_rad)[order])
    kd = like(exact, np.array(contract.kd_nm_s_per_rad)[order])
    scaled = (kp * position[..., order], kd * velocity[..., order], contract.action_scale_rad * kp * action[..., order])
    xp = namespace_of(exact)
    return xp.astype(xp.concat(scaled, axis=-1), xp.float32)


def features_of_run(run: Run, policy: Policy, at_least: int = 0) -> Any:
    """Those of a log's :func:`~trainer.signals.policy_ticks.policy_ticks`, shape (n, 36)."""
    rows = policy_ticks(run, at_least)
    return features_of_observations(run.ticks.observation[rows], run.ticks.action[rows], policy)


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


MEASURES: Final = ("w1", "mmd")
"""Measures of the score: Wasserstein (mean over the 36 features, N·m) and MMD (on all 36 at once, no unit)."""


def wasserstein_sorted(first: NDArray[Any], second: NDArray[Any]) -> NDArray[np.float64]:
    """Exact 1-Wasserstein distance between sorted samples, along the last axis.

    W₁ = ∫₀¹ |F⁻¹(u) − G⁻¹(u)| du; with equally many samples, the mean distance between those of equal rank.

    Args:
        first: Sorted samples. Shape (..., n), n ≥ 1, any unit.
        second: Sorted samples. Shape (..., m), m ≥ 1, same unit; leading axes broadcast.

    Returns:
        Distance, leading shape after broadcasting, same unit.

    Source: Villani, Optimal Transport (2009), remark 2.19; :func:`scipy.stats.wasserstein_distance` agrees.
    """
    n, m = first.shape[-1], second.shape[-1]
    if n == m:
        return np.asarray(np.mean(np.abs(first - second), axis=-1, dtype=np.float64))
    # Both quantile functions are constant between neighbouring multiples of 1/n and 1/m.
    edges = np.union1d(np.arange(1, n + 1) * m, np.arange(1, m + 1) * n)
    weights = np.diff(edges, prepend=0) / (n * m)
    of_first = np.ceil(edges / m).astype(np.intp) - 1
    of_second = np.ceil(edges / n).astype(np.intp) - 1
    return np.asarray(np.abs(first[..., of_first] - second[..., of_second]) @ weights, dtype=np.float64)


@dataclass(frozen=True)
class RunDigest:
    """What the measures need of one run's samples."""

    sorted_features: NDArray[np.float32]
    """Shape (36, n)."""
    embedding: Array
    """Mean Fourier features, shape (2 n_frequencies,)."""


@dataclass(frozen=True)
class SequenceReference:
    """The real runs of one command sequence, ready to be compared with."""

    sequence: str
    real: tuple[RunDigest, ...]
    fourier: FourierFeatures
    bandwidth_nm: float
    pair_distances: Array
    """Between real runs, shape (n_real, n_real, 2), zero on the diagonal."""
    scale: Array
    """What a distance is divided by in the score, shape (2,): the floor, or without repeats the samples' spread."""

    @staticmethod
    def build(sequence: str, real_features: list[NDArray[np.float32]], seed: int = 0) -> SequenceReference:
        """Prepare from the real runs' features, each of shape (n, 36).

        Raises:
            ValueError: No run, or samples without any spread.
        """
        if not real_features:
            raise ValueError(f"sequence {sequence!r} has no real run")
        pooled = np.concatenate(real_features)
        bandwidth = median_bandwidth(pooled)
        fourier = FourierFeatures.draw(np.random.default_rng(seed), pooled.shape[1], 192, bandwidth)
        digests = tuple(digest(f, fourier) for f in real_features)
        pairs = np.array([[distance(a, b) for b in digests] for a in digests])
        n = len(digests)
        if n > 1:
            scale = pairs.sum(axis=(0, 1)) / (n * (n - 1))
        else:
            centre = digest(np.median(pooled, axis=0, keepdims=True), fourier)
            scale = distance(digests[0], centre)
        return SequenceReference(sequence, digests, fourier, bandwidth, pairs, scale)

    @property
    def floor(self) -> Array | None:
        """Mean distance between two different real runs, shape (2,); None without repeats."""
        return self.scale if len(self.real) > 1 else None

    def distances(self, features: NDArray[Any]) -> Array:
        """From one simulated run, shape (n, 36), to each real run, shape (n_real, 2); NaN if the run is not finite."""
        if not np.all(np.isfinite(features)):
            return np.full((len(self.real), len(MEASURES)), np.nan)
        simulated = digest(features, self.fourier)
        return np.array([distance(simulated, real) for real in self.real])

    def distances_of_many(self, features: Any) -> Array:
        """From many simulated runs, shape (k, n, 36), to each real run, shape (k, n_real, 2).

        Those of :meth:`distances`; a tensor's, which are worked out together, up to its rounding.
        """
        if isinstance(features, np.ndarray):
            return np.stack([self.distances(run) for run in features])
        xp = namespace_of(features)
        is_finite = on_host(xp.all(xp.isfinite(features), axis=(1, 2)))
        samples = xp.where(xp.isfinite(features), features, xp.zeros_like(features))
        ordered = xp.sort(xp.permute_dims(samples, (0, 2, 1)), axis=-1)
        phase = samples @ like(samples, self.fourier.frequencies)
        means = xp.concat([xp.mean(xp.cos(phase), axis=1), xp.mean(xp.sin(phase), axis=1)], axis=-1)
        embedding = on_host(means) / np.sqrt(self.fourier.frequencies.shape[1])
        pairs = np.empty((len(samples), len(self.real), len(MEASURES)))
        for column, real in enumerate(self.real):
            pairs[:, column, 0] = _mean_w1(ordered, real.sorted_features)
            pairs[:, column, 1] = embedding_distance(embedding, real.embedding)
        pairs[~is_finite] = np.nan
        return pairs


def _mean_w1(ordered: Any, real: NDArray[np.float32]) -> Array:
    """Mean over features of the Wasserstein distance, shape (k,), of sorted samples (k, 36, n) to (36, m)."""
    xp, n, m = namespace_of(ordered), ordered.shape[-1], real.shape[-1]
    edges = np.union1d(np.arange(1, n + 1) * m, np.arange(1, m + 1) * n)
    weights = like(ordered, np.diff(edges, prepend=0) / (n * m))
    mine, theirs = (np.ceil(edges / size).astype(np.intp) - 1 for size in (m, n))
    gaps = xp.abs(ordered[..., mine.tolist()] - like(ordered, real[:, theirs]))
    return on_host(xp.mean(gaps @ weights, axis=-1)).astype(np.float64)


def digest(features: NDArray[Any], fourier: FourierFeatures) -> RunDigest:
    """Sort and embed one run's features, shape (n, 36)."""
    samples = np.asarray(features, dtype=np.float32)
    return RunDigest(np.sort(np.ascontiguousarray(samples.T), axis=-1), fourier.mean_embedding(samples))


def score_of_distances(distances: Array, scale: Array) -> Array:
    """Average pair distances to one number a sequence, in units of ``scale`` (1 = the floor).

    Args:
        distances: Shape (..., n_sim, n_real, 2).
        scale: Shape (2,).

    Returns:
        Shape (...). Not finite where a distance is not.
    """
    by_real = np.mean(distances, axis=-3)
    n_real = by_real.shape[-2]
    by_measure = np.einsum("...rm,r->...m", by_real, np.full(n_real, 1.0 / n_real))
    return np.asarray(np.mean(by_measure / scale, axis=-1))


def distance(first: RunDigest, second: RunDigest) -> Array:
    """Both measures between two runs, shape (2,)."""
    w1 = wasserstein_sorted(first.sorted_features, second.sorted_features).mean()
    return np.array([w1, embedding_distance(first.embedding, second.embedding)])
