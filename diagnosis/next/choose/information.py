"""How much an experiment tells of the cause: mutual information of cause and run, by simulation.

With x a run's signature and h its cause, x | h is taken as normal with a mean for each cause and one covariance for
all, the scatter of robots of one cause (ordinary errors, sizes of effects, noise), shrunk after Ledoit and Wolf. Bayes'
rule gives q(h | x), and

    I ≥ H(h) + E log₂ q(h | x)

is a lower bound of the mutual information for any q (Barber and Agakov 2003). The expectation is over robots that the
fit of q did not see, so few robots make the bound loose, not optimistic. One run in ten counts as odd, as in the
posterior: q' = (1 − ε) q + ε p(h).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from diagnosis.decision_constants import FORMULA_ERROR, ODD_RUN
from spot_model.robot.facts import Array

FOLDS: Final = 4


@dataclass(frozen=True)
class Told:
    """What one run of an experiment tells, on average."""

    bits: float
    of_bits: float
    """Entropy of the causes before."""
    confusion: Array
    """Mean probability of each cause (column) after a run on a robot of each (row), shape (C, C)."""


def entropy_bits(weights: Array) -> float:
    """Of probabilities, shape (C,)."""
    own = weights[weights > 0.0]
    return float(-np.sum(own * np.log2(own)))


def told_by(signatures: Array, cause_of: Array, weights: Array, rng: np.random.Generator) -> Told:
    """What an experiment tells.

    Args:
        signatures: One a robot, shape (n, k), in units of what formulas leave.
        cause_of: Cause of each robot, shape (n,), each cause as often.
        weights: Probabilities of the causes, shape (C,).
        rng: Draws what formulas leave, and folds.
    """
    n_causes = len(weights)
    x = signatures + _formula_errors(signatures, cause_of, rng)
    fold = np.zeros(len(x), dtype=np.intp)
    for cause in range(n_causes):
        rows = np.flatnonzero(cause_of == cause)
        fold[rng.permutation(rows)] = np.arange(len(rows)) % FOLDS
    belief = np.zeros((len(x), n_causes))
    for k in range(FOLDS):
        seen, new = fold != k, fold == k
        varies = x[seen].std(axis=0) > 1e-9
        model = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto", priors=weights / weights.sum())
        model.fit(x[seen][:, varies], cause_of[seen])
        belief[new] = model.predict_proba(x[new][:, varies])
    belief = (1.0 - ODD_RUN) * belief + ODD_RUN * weights
    confusion = np.array([belief[cause_of == c].mean(axis=0) for c in range(n_causes)])
    own = np.log2(belief[np.arange(len(x)), cause_of])
    mean = np.array([own[cause_of == c].mean() for c in range(n_causes)])
    before = entropy_bits(weights)
    return Told(max(0.0, before + float(weights @ mean)), before, confusion)


def _formula_errors(signatures: Array, cause_of: Array, rng: np.random.Generator) -> Array:
    """Errors of formulas: one unit everywhere, and a share of what sets a cause apart from all others."""
    centre = np.median(signatures, axis=0)
    apart = np.array([signatures[cause_of == c].mean(axis=0) - centre for c in range(int(cause_of.max()) + 1)])
    share = FORMULA_ERROR * rng.standard_normal((len(signatures), 1)) * apart[cause_of]
    return np.asarray(share + rng.standard_normal(signatures.shape))
