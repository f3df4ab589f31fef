"""How much of the gap goes away: the paper's W1 + MMD of closed-loop runs, before and after, with an interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm as normal
from scipy.stats import t as student

from diagnosis.channels.channel_view import Array
from diagnosis.read.policy_ticks import features
from spot_log.read.run import Run
from spot_model.policy.policy import Policy
from trainer.sysid.distance.measures import SequenceReference

N_RESAMPLES: Final = 1000
LEVEL: Final = 0.90
MIN_GAP: Final = 0.05
"""A gap that exceeds its floor by less than this share of the floor has nothing to shrink."""

MIN_TICKS: Final = 50
"""A run of less than a second is no sample of a gait."""
WHOLE: Final = 0.9
"""A run of less than this share of the longest one fell, or was cut, and is not compared with whole ones."""

Features = Sequence[NDArray[np.float32]]
"""Of the runs of one sequence, each of shape (n, 36)."""


@dataclass(frozen=True)
class Compared:
    """One command sequence: pair distances, in units of the floor's two parts."""

    sequence: str
    real: Array
    """Between real runs, shape (R, R), zero on the diagonal."""
    models: Mapping[str, Array]
    """From runs of each model to real runs, shape (S, R); row i of all models starts alike."""
    scale: Array = field(default_factory=lambda: np.ones(2))
    """What a distance of each of the two parts was divided by, shape (2,)."""


@dataclass(frozen=True)
class Shrinkage:
    """A share with its interval, and what it is made of."""

    d0: float
    d1: float
    floor: float
    s: float | None
    low: float | None
    high: float | None


def features_by_sequence(runs: Sequence[Run], policy: Policy) -> dict[str, list[NDArray[np.float32]]]:
    """Features of the runs that are whole, by sequence; of a sequence without a whole one, of those there are."""
    found: dict[str, list[NDArray[np.float32]]] = {}
    for run in runs:
        own = features(run, policy)
        if len(own) >= MIN_TICKS:
            found.setdefault(run.header.command_sequence or "unnamed", []).append(own)
    return {name: [f for f in own if len(f) >= WHOLE * max(len(g) for g in own)] for name, own in found.items()}


def compare(sequence: str, real: Features, models: Mapping[str, Features], seed: int = 0, steady: str = "") -> Compared:
    """Distances of one sequence.

    Args:
        sequence: Its name.
        real: Real runs' features.
        models: By model, its runs' features.
        seed: Of the measure's random features.
        steady: Model that scatters at least as a robot does that walks. Where the robot did not repeat itself, models
            that stumble give no larger floor than this one.
    """
    reference = SequenceReference.build(sequence, list(real), seed)
    scale = reference.scale
    if len(real) == 1:
        # The robot did not repeat itself: what its models scatter by stands in for what it scatters by.
        own = {n: SequenceReference.build(sequence, list(r), seed).scale for n, r in models.items() if len(r) > 1}
        scale = np.median(list(own.values()), axis=0) if own else scale
        scale = np.minimum(scale, own.get(steady, scale))

    def one_number(distances: Array) -> Array:
        return np.asarray(np.mean(distances / scale, axis=-1))

    return Compared(
        sequence,
        one_number(reference.pair_distances),
        {name: one_number(np.array([reference.distances(f) for f in runs])) for name, runs in models.items()},
        scale,
    )


def shrinkage(
    compared: Sequence[Compared],
    before: str,
    after: str,
    rng: np.random.Generator,
    doubt: float = 0.0,
) -> Shrinkage:
    """S = (D0 − D1)/(D0 − floor), averaged over sequences, with a paired hierarchical bootstrap.

    Each resample draws sequences, within them real runs, and simulated runs, the same for both models. Without
    repeats the floor is the scatter of simulated runs.

    Args:
        compared: By sequence.
        before: Name of the nominal model.
        after: Name of the corrected one.
        rng: Draws the resamples.
        doubt: Standard error of the distance after that no resample holds: other surroundings might have been chosen.
    """
    d0 = float(np.mean([c.models[before].mean() for c in compared]))
    d1 = float(np.mean([c.models[after].mean() for c in compared]))
    floor = float(np.mean([_floor(c.real) for c in compared]))
    if d0 - floor <= MIN_GAP * max(floor, 1e-9):
        return Shrinkage(d0, d1, floor, None, None, None)
    draws = []
    for _ in range(N_RESAMPLES):
        chosen = rng.integers(len(compared), size=len(compared))
        sums = np.zeros(3)
        for i in chosen:
            c = compared[i]
            n_real = c.real.shape[0]
            real = rng.integers(n_real, size=n_real)
            n_sim = c.models[before].shape[0]
            simulated = rng.integers(n_sim, size=n_sim)
            n_after = c.models[after].shape[0]
            other = simulated if n_after == n_sim else rng.integers(n_after, size=n_after)
            d_before, d_after = c.models[before][np.ix_(simulated, real)], c.models[after][np.ix_(other, real)]
            sums += d_before.mean(), d_after.mean(), _floor(c.real, real)
        if sums[0] - sums[2] > 1e-9:
            draws.append((sums[0] - sums[1]) / (sums[0] - sums[2]))
    s = (d0 - d1) / (d0 - floor)
    if not draws:
        return Shrinkage(d0, d1, floor, s, None, None)
    tail = 50.0 * (1.0 - LEVEL)
    low, high = np.percentile(draws, [tail, 100.0 - tail])
    # Three sequences have ten resamples that differ: percentiles fall between them, the standard deviation does not.
    edges = np.percentile(draws, [1.0, 99.0])
    reach = float(normal.ppf(1.0 - tail / 100.0) * np.std(np.clip(draws, *edges)))
    wider = _few([min(c.real.shape[0], c.models[before].shape[0]) for c in compared])
    below, above = max(s - float(low), reach), max(float(high) - s, reach)
    around = float(normal.ppf(1.0 - tail / 100.0) * doubt / (d0 - floor))
    return Shrinkage(
        d0, d1, floor, s, s - float(np.hypot(wider * below, around)), s + float(np.hypot(wider * above, around))
    )


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


def _floor(pairs: Array, chosen: NDArray[np.intp] | None = None) -> float:
    """Mean distance of two different real runs; without repeats the unit, which simulated runs gave."""
    n = len(pairs)
    if n < 2:
        return 1.0
    index = np.arange(n) if chosen is None else chosen
    different = index[:, None] != index[None, :]
    if not different.any():
        return float(pairs.sum() / (n * (n - 1)))
    return float(pairs[np.ix_(index, index)][different].mean())
