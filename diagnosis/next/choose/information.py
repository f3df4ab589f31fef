"""How much an experiment tells of the cause: mutual information of cause and run, by simulation.

With x a run's signature and h its cause, x | h is taken as normal with one covariance for all causes: the scatter of
robots of one cause (ordinary errors, sizes of effects, noise). Two causes lie Δ apart, in standard deviations along the
direction that parts them best, and

    I ≥ −Σᵢ wᵢ log₂ Σⱼ wⱼ exp(−Δᵢⱼ²/8)

is a lower bound of the mutual information (Kolchinsky and Tracey 2017, by Bhattacharyya distances). A few robots find
no direction in two hundred numbers, so each number counts by itself, and only where it sets the two causes apart by
:data:`CLEAR` standard errors. Δ is measured on robots that the choice of the direction did not see: a direction that is
not the best makes the bound loose, not optimistic. One run in ten counts as odd, and tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy.special import ndtr
from scipy.stats import entropy

from diagnosis.decision_constants import FORMULA_ERROR, ODD_RUN
from spot_model.robot.facts import Array

FOLDS: Final = 3
CLEAR: Final = 3.0
ENOUGH: Final = 0.8
REDRAWN: Final = 6
"""Draws of folds, and of what formulas leave, over which Δ is averaged."""


@dataclass(frozen=True)
class Told:
    """What one run of an experiment tells, on average."""

    bits: float
    of_bits: float
    """Entropy of the causes before."""
    apart: Array
    """Δ of each two causes, shape (C, C)."""

    @property
    def is_enough(self) -> bool:
        """Whether it is nearly all that one run can tell: a better experiment is not worth looking for."""
        return self.bits >= ENOUGH * (1.0 - ODD_RUN) * self.of_bits

    def right(self, first: int, second: int) -> float:
        """How often a run tells these two causes apart rightly."""
        return float((1.0 - ODD_RUN) * ndtr(0.5 * self.apart[first, second]) + 0.5 * ODD_RUN)


def told_by(signatures: Array, cause_of: Array, weights: Array, rng: np.random.Generator) -> Told:
    """What an experiment tells.

    Args:
        signatures: One a robot, shape (n, k), in units of what formulas leave.
        cause_of: Cause of each robot, shape (n,), each cause as often.
        weights: Probabilities of the causes, shape (C,).
        rng: Draws what formulas leave, and folds.
    """
    n_causes = len(weights)
    apart = np.zeros((n_causes, n_causes))
    for _ in range(REDRAWN):
        x = signatures + _formula_errors(signatures, cause_of, rng)
        groups = [x[rng.permutation(np.flatnonzero(cause_of == c))] for c in range(n_causes)]
        folds = []
        for fold in range(FOLDS):
            is_new = [np.arange(len(own)) % FOLDS == fold for own in groups]
            folds.append([(own[~new], own[new]) for own, new in zip(groups, is_new, strict=True)])
        for i, j in combinations(range(n_causes), 2):
            apart[i, j] += _apart(folds, i, j) / REDRAWN
    apart += apart.T
    near = np.exp(-(apart**2) / 8.0) @ weights
    return Told(float((1.0 - ODD_RUN) * -weights @ np.log2(near)), float(entropy(weights, base=2)), apart)


def _apart(folds: Sequence[Sequence[tuple[Array, Array]]], i: int, j: int) -> float:
    """Δ of two causes; ``folds`` has the robots of each cause that are seen and that are new, shapes (n, k)."""
    sides: tuple[list[Array], list[Array]] = [], []
    for groups in folds:
        seen = [own for own, _ in groups]
        left = sum(((own - own.mean(axis=0)) ** 2).sum(axis=0) for own in seen)
        variance = np.maximum(left / sum(len(own) - 1 for own in seen), 1.0)
        first, second = seen[i].mean(axis=0), seen[j].mean(axis=0)
        is_clear = (first - second) ** 2 > CLEAR**2 * variance * (1.0 / len(seen[i]) + 1.0 / len(seen[j]))
        direction = np.where(is_clear, (first - second) / variance, 0.0)
        size = np.sqrt(float(direction**2 @ variance)) or 1.0
        for side, (_, new) in zip(sides, (groups[i], groups[j]), strict=True):
            side.append((new - 0.5 * (first + second)) @ direction / size)
    a, b = map(np.concatenate, sides)
    free = len(a) + len(b) - 2
    variance_along = (np.sum((a - a.mean()) ** 2) + np.sum((b - b.mean()) ** 2)) / free
    if variance_along == 0.0:
        return 0.0
    away = max(float(a.mean() - b.mean()), 0.0)
    # Unbiased: the square of a mean is too large by its variance, one over a variance by free / (free - 2).
    square = (free - 2) / free * away**2 / variance_along - 1.0 / len(a) - 1.0 / len(b)
    return float(np.sqrt(max(square, 0.0)))


def _formula_errors(signatures: Array, cause_of: Array, rng: np.random.Generator) -> Array:
    """Errors of formulas: one unit everywhere, and a share of what sets a cause apart from all others."""
    centre = np.median(signatures, axis=0)
    apart = np.array([signatures[cause_of == c].mean(axis=0) - centre for c in range(int(cause_of.max()) + 1)])
    share = FORMULA_ERROR * rng.standard_normal((len(signatures), 1)) * apart[cause_of]
    return np.asarray(share + rng.standard_normal(signatures.shape))
