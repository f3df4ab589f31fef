"""Parameter intervals from the search's evaluations: a quadratic surrogate, refitted over resampled real runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from trainer.sysid.search.problem import CandidateResult, Problem

Array = NDArray[np.float64]

N_BOOTSTRAP: Final = 200
BEST_SHARE: Final = 0.5
"""Share of the evaluations, the best ones, that the surrogate is fitted to."""
RIDGE: Final = 1e-3


@dataclass(frozen=True)
class ScoreIntervals:
    """Where the score's minimum lies, as far as repeats and the chaos of the runs allow to tell."""

    best: Array
    """Physical values at the surrogate's minimum, shape (n,)."""
    low: Array
    high: Array


def score_intervals(
    problem: Problem, unit: Array, results: Sequence[CandidateResult], confidence: float, rng: np.random.Generator
) -> ScoreIntervals | None:
    """Resample real runs and evaluations, refit the surrogate each time, and take quantiles of its minimum.

    Args:
        problem: What was searched.
        unit: Evaluated points of the unit cube, shape (n_evaluations, n).
        results: Their results.
        confidence: Of the central interval, for instance 0.9.
        rng: Source of the resampling.

    Returns:
        The intervals, or None where no sequence has repeats or too few evaluations are finite.
    """
    n_real = [len(reference.real) for reference in problem.references]
    if max(n_real) < 2:
        return None
    distances = [np.stack([r.distances[i] for r in results]) for i in range(len(n_real))]
    by_real = [
        (d.mean(axis=1) / reference.scale).mean(axis=-1)
        for d, reference in zip(distances, problem.references, strict=True)
    ]
    weights = np.array(problem.sequence_weights)

    def scores(real_weights: Sequence[Array]) -> Array:
        return np.asarray(sum(w * (b @ r) for w, b, r in zip(weights, by_real, real_weights, strict=True)))

    plain = scores([np.full(n, 1.0 / n) for n in n_real])
    finite = np.flatnonzero(np.isfinite(plain))
    n_terms = _terms(unit[:1]).shape[1]
    kept = finite[np.argsort(plain[finite])[: max(int(BEST_SHARE * len(finite)), 2 * n_terms)]]
    if len(kept) < 2 * n_terms:
        return None
    minima = []
    for _ in range(N_BOOTSTRAP):
        drawn = [rng.multinomial(n, np.full(n, 1.0 / n)) / n for n in n_real]
        rows = rng.choice(kept, len(kept))
        minima.append(_minimum(unit[rows], scores(drawn)[rows]))
    tail = (1.0 - confidence) / 2.0
    values = problem.space.values_of_unit(np.array(minima))
    low, high = np.quantile(values, [tail, 1.0 - tail], axis=0)
    return ScoreIntervals(problem.space.values_of_unit(_minimum(unit[kept], plain[kept])), low, high)


def _terms(unit: Array) -> Array:
    n = unit.shape[1]
    first, second = np.triu_indices(n)
    centred = unit - 0.5
    return np.concatenate([np.ones((len(unit), 1)), centred, centred[:, first] * centred[:, second]], axis=1)


def _minimum(unit: Array, score: Array) -> Array:
    """Minimum of a ridge-fitted quadratic within the box of the points, shape (n,)."""
    n = unit.shape[1]
    terms = _terms(unit)
    penalty = RIDGE * len(unit) * np.diag([0.0] + [1.0] * (terms.shape[1] - 1))
    coefficients = np.linalg.solve(terms.T @ terms + penalty, terms.T @ score)
    gradient = coefficients[1 : n + 1]
    hessian = np.zeros((n, n))
    hessian[np.triu_indices(n)] = coefficients[n + 1 :]
    hessian = hessian + hessian.T
    values, vectors = np.linalg.eigh(hessian)
    hessian = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    low, high = unit.min(axis=0) - 0.5, unit.max(axis=0) - 0.5
    start = np.clip(unit[np.argmin(score)] - 0.5, low, high)
    found = scipy.optimize.minimize(
        lambda x: gradient @ x + 0.5 * x @ hessian @ x,
        start,
        jac=lambda x: gradient + hessian @ x,
        bounds=list(zip(low, high, strict=True)),
        method="L-BFGS-B",
    )
    return np.asarray(found.x + 0.5)
