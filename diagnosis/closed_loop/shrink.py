"""How much of the gap goes away: the paper's W1 + MMD of closed-loop runs, before and after, with an interval."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm as normal
from scipy.stats import t as student

from diagnosis.channels import Array
from diagnosis.decision_constants import MIN_GAP
from spot_log.read.run import Run
from spot_model.policy.policy import Policy
from trainer.signals.distances import SequenceReference, digest, distance, features_of_run
from trainer.signals.policy_ticks import MIN_TICKS

N_RESAMPLES: Final = 1000
LEVEL: Final = 0.90
QUANTILES: Final = (np.arange(100) + 0.5) / 100
"""Quantiles of a signal's digest; their mean difference is the Wasserstein distance."""
WHOLE: Final = 0.9
"""Of two runs, one of less than this share of the other one fell, or was cut: they are compared up to its end."""

Features = Sequence[NDArray[np.float32]]
"""Features of the runs of one sequence, each of shape (n, 36)."""


@dataclass(frozen=True)
class SequenceDistances:
    """One command sequence: pair distances, in one unit."""

    sequence: str
    real: Array
    """Between real runs, shape (R, R), zero on the diagonal."""
    models: Mapping[str, Array]
    """From runs of each model to real runs, shape (S, R); row i of all models starts alike."""
    scale: Array = field(default_factory=lambda: np.ones(2))
    """What a distance of each of the measure's two parts was divided by, shape (2,)."""
    floor: float = 1.0
    """Where the robot did not repeat itself, what stands in for the distance between two of its runs."""
    least: float = 0.0
    """A distance, in the same unit, that is nothing to anybody: no mean over sequences counts as less."""


class Cuts(NamedTuple):
    """The runs of one side of one sequence, each as what a distance needs of its first ticks."""

    lengths: Sequence[int]
    """Ticks of each run."""
    to: Callable[[int, int], Any]
    """Digest of run i up to tick n."""


def pair_distances(first: Cuts, second: Cuts, distance: Callable[[Any, Any], Any]) -> Array:
    """From each run of one side to each of the other, up to the end of the shorter where that fell or was cut.

    Returns:
        Shape (F, S), with more axes where ``distance`` has some.
    """

    def one(i: int, j: int) -> Any:
        n, m = first.lengths[i], second.lengths[j]
        if min(n, m) < WHOLE * max(n, m):
            n = m = min(n, m)
        return distance(first.to(i, n), second.to(j, m))

    return np.array([[one(i, j) for j in range(len(second.lengths))] for i in range(len(first.lengths))])


class Shrinkage(NamedTuple):
    """A share with its interval, and what it is made of."""

    d0: float
    d1: float
    floor: float
    s: float | None
    low: float | None
    high: float | None


def sequence_name(run: Run) -> str:
    """Name of the command sequence that a run follows."""
    return run.header.command_sequence or "unnamed"


def features_by_sequence(
    runs: Sequence[Run], policy: Policy, at_least: int = 0
) -> dict[str, list[NDArray[np.float32]]]:
    """Features of the runs by sequence, each up to its fall; runs of less than :data:`MIN_TICKS` are left out.

    With ``at_least``, so many ticks are kept even of a robot that falls sooner, and no run is left out.
    """
    found: dict[str, list[NDArray[np.float32]]] = {}
    for run in runs:
        own = features_of_run(run, policy, at_least)
        if len(own) >= MIN_TICKS or at_least:
            found.setdefault(sequence_name(run), []).append(own)
    return found


def simulated_features(runs: Sequence[Run], policy: Policy) -> dict[str, list[NDArray[np.float32]]]:
    """Features of all simulated runs, in their order; of one that falls at once, those of its fall, a second long."""
    return features_by_sequence(runs, policy, MIN_TICKS)


def sequence_distances(
    sequence: str, real: Features, models: Mapping[str, Features], steady: str = ""
) -> SequenceDistances:
    """Distances of one sequence, in floors, from the features of real runs and of each model's.

    ``steady`` is a model that scatters at least as a robot does that walks. Where the robot did not repeat itself,
    models that stumble give no larger floor than this one.
    """
    reference = SequenceReference.build(sequence, list(real))

    def cuts(runs: Features) -> Cuts:
        return Cuts([len(f) for f in runs], cache(lambda i, n: digest(runs[i][:n], reference.fourier)))

    own = cuts(real)
    pairs = pair_distances(own, own, distance)
    scale = pairs.sum(axis=(0, 1)) / max(1, len(real) * (len(real) - 1))
    if not (scale > 0.0).all():
        # The robot did not repeat itself, or to the last bit: what its models scatter by stands in for its own.
        others = {n: SequenceReference.build(sequence, list(r)).scale for n, r in models.items() if len(r) > 1}
        scale = (
            np.median(list(others.values()), axis=0) if others else SequenceReference.build(sequence, [real[0]]).scale
        )
        scale = np.minimum(scale, others.get(steady, scale))

    def one_number(distances: Array) -> Array:
        return np.asarray(np.mean(distances / scale, axis=-1))

    apart = {name: one_number(pair_distances(cuts(runs), own, distance)) for name, runs in models.items()}
    return SequenceDistances(sequence, one_number(pairs), apart, scale)


def shrinkage(
    compared: Sequence[SequenceDistances], before: str, after: str, rng: np.random.Generator, doubt: float = 0.0
) -> Shrinkage:
    """S = (D0 − D1)/(D0 − floor), at most 1, averaged over sequences, with a paired hierarchical bootstrap.

    Each resample draws sequences, within them real runs, and simulated runs, the same for both models. Without
    repeats the floor is the scatter of simulated runs. ``doubt`` is a standard error of the distance after that no
    resample holds: other surroundings might have been chosen.
    """
    d0, d1, floor = mean_distance(compared, before), mean_distance(compared, after), mean_floor(compared)
    if d0 - floor <= MIN_GAP * max(floor, 1e-9):
        return Shrinkage(d0, d1, floor, None, None, None)
    sizes = [(c.real.shape[0], c.models[before].shape[0]) for c in compared]
    chosen, counts = resamples(sizes, rng)
    sums = np.zeros((4, *chosen.shape))
    for i, (c, (real, simulated)) in enumerate(zip(compared, counts, strict=True)):
        one, other = (((simulated @ c.models[m]) * real).mean(axis=2) / len(simulated.T) for m in (before, after))
        drawn = np.array(np.broadcast_arrays(one, other, _repeats(c, real), c.least))
        sums += drawn * (chosen == i)
    *distances, least = sums.sum(axis=2)
    first, second, repeats = np.maximum(distances, least)
    is_gap = first - repeats > 1e-9
    draws = ((first - second)[is_gap] / (first - repeats)[is_gap]).tolist()
    s = min((d0 - max(d1, _least(compared))) / (d0 - floor), 1.0)
    if not draws:
        return Shrinkage(d0, d1, floor, s, None, None)
    low, high = interval(s, draws, [min(size) for size in sizes], doubt / (d0 - floor))
    return Shrinkage(d0, d1, floor, s, low, min(high, 1.0))


def mean_distance(compared: Sequence[SequenceDistances], model: str) -> float:
    """Mean distance of a model's runs from the robot's."""
    return float(np.mean([c.models[model].mean() for c in compared]))


def mean_floor(compared: Sequence[SequenceDistances]) -> float:
    """Where a gap begins: at the mean distance of the robot's repeats, but not under what is nothing to anybody."""
    return max(mean_repeats(compared), _least(compared))


def mean_repeats(compared: Sequence[SequenceDistances]) -> float:
    """Mean distance of the robot's runs from each other, or what stands in for it."""
    return float(np.mean([_repeats(c) for c in compared]))


def _least(compared: Sequence[SequenceDistances]) -> float:
    return float(np.mean([c.least for c in compared]))


def resamples(
    sizes: Sequence[tuple[int, int]], rng: np.random.Generator
) -> tuple[NDArray[np.int64], list[tuple[NDArray[np.int64], NDArray[np.int64]]]]:
    """:data:`N_RESAMPLES` times sequences, and runs of the two sides of each, drawn with replacement.

    Returns:
        The S sequences of each draw, shape (N, S); and by sequence how often each run of either side is in the draw at
        a place of it, shape (N, S, number of runs).
    """
    shape = (N_RESAMPLES, len(sizes))
    chosen = rng.integers(len(sizes), size=shape)
    one, other = (
        [rng.multinomial(n, np.full(n, 1.0 / max(n, 1)), size=shape) for n in side] for side in zip(*sizes, strict=True)
    )
    return chosen, list(zip(one, other, strict=True))


def interval(value: float, draws: Sequence[float], counts: Sequence[int], doubt: float = 0.0) -> tuple[float, float]:
    """The 90 % interval of a value from that of each of its :func:`resamples`.

    ``counts`` are the runs of each sequence; ``doubt`` is a standard error that no resample holds.
    """
    tail = 50.0 * (1.0 - LEVEL)
    z = float(normal.ppf(1.0 - tail / 100.0))
    low, high = np.percentile(draws, [tail, 100.0 - tail])
    # Three sequences have ten resamples that differ: percentiles fall between them, the standard deviation does not.
    reach = z * float(np.std(np.clip(draws, *np.percentile(draws, [1.0, 99.0]))))
    wider = _few(counts)
    below, above = max(value - float(low), reach), max(float(high) - value, reach)
    return value - float(np.hypot(wider * below, z * doubt)), value + float(np.hypot(wider * above, z * doubt))


def _few(counts: Sequence[int]) -> float:
    """What an interval from resampled sequences and runs is too narrow by, from runs by sequence.

    A few things resampled with replacement scatter less than they do, by n/(n − 1) in variance, and a spread that few
    show is itself uncertain: Student's factor. Both count for the sequences, since S is meant for other commands
    too, and for the runs, with one degree of freedom less than runs in each sequence; the larger of the two holds.
    """
    return max(_widening(len(counts), len(counts) - 1), _widening(min(counts), sum(n - 1 for n in counts)))


def _widening(n: int, freedom: int) -> float:
    if n < 2:
        return 1.0
    high = 0.5 * (1.0 + LEVEL)
    return float(np.sqrt(n / (n - 1)) * student.ppf(high, freedom) / normal.ppf(high))


def _repeats(c: SequenceDistances, counts: NDArray[np.int64] | None = None) -> Array:
    """Mean distance of two different real runs, which count so often, (..., R) to (...); or what stands in for it."""
    n = len(c.real)
    if n < 2:
        return np.array(c.floor)
    every = np.ones(n, dtype=np.int64)
    times = every if counts is None else counts
    times = np.where((times == n).any(axis=-1, keepdims=True), every, times)
    return np.asarray(((times @ c.real) * times).sum(axis=-1) / (n**2 - (times**2).sum(axis=-1)))
