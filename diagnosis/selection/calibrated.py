"""The robot's ordinary errors: how far they scatter, and what they are once effects are chosen.

The robot's own numbers, fitted: what joints of a type have in common is free within its published range.

The search expects a type's common error to be as small, beside its published range, as the joints' own scatter, so that
what is larger shows as a difference. Once differences are chosen, that would hold numbers near the nominal ones, and
one number to joint types that have several. So they are fitted once more, what units share with its published range, or
with that of a single unit where a model has one number for all of a type.

How far this robot's ordinary errors scatter, learned from its own logs: empirical Bayes over the units of each kind.

With γ the errors of n units of a kind in published sizes, about what units of a type have in common, and v their
posterior variances, the kind's variance is s² = (n₀ + Σ (γ² + v)) / (n₀ + n): expectation and maximisation in turn,
with n₀ units of prior weight at the published size. A unit far off the others counts as one at three robust
deviations: it is for the search to say what it is.

What units have in common is one number, and teaches no scale. It is expected to be as small, beside its published
range, as the units' own scatter: a robot whose joints differ by one per cent is hardly off by ten at all of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.linalg import cho_solve

from diagnosis.channels import Array
from diagnosis.decision_constants import ERROR_SCALES, NARROWEST
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.normal_equations import ColumnProducts, products_by_fold
from diagnosis.selection.ordinary_errors import ErrorKind
from diagnosis.selection.scoring import Scored, bounds, fitted_under, null_of, sums_of, term_columns, weights_of


def calibrated(board: Evidence, scored: Scored) -> Scored:
    """The same effects, maybe none, fitted with the ordinary errors of :func:`free_types`; scores stay."""
    tried, by_fold = _tried(board, scored)
    weights = weights_of(board, scored.held_out, scored.explained)
    found = fitted_under(board, scored.terms, tried, by_fold, weights, free_types(board))
    return replace(found, score=scored.score, by_block=scored.by_block)


def free_types(board: Evidence) -> Array:
    """Precision of the ordinary errors with published ranges for what units share, in their usual sizes; shape (Q,)."""
    ordinary = board.ordinary
    out = np.ones(ordinary.size)
    for kind in ordinary.kinds:
        # Load cells and zeros are set one by one; all else is as often wrong for a type as for a unit.
        one_by_one = kind.effect.of_load_cell or kind.effect.singly
        share = 1.0 if one_by_one else min(1.0, ERROR_SCALES[kind.effect.name].alike)
        for k in range(len(kind.chosen)):
            at = kind.columns(k)[kind.alike]
            out[at] = (share * ordinary.scale[at] / ordinary.published[at]) ** 2
    return out


def posterior_covariance(board: Evidence, scored: Scored, precision: Array | float = 1.0) -> Array:
    """Covariance of what was fitted, given the logs: ordinary errors in usual sizes, then the terms' coefficients.

    Shape (Q + K, Q + K), in the units of ``scored.pulls`` and ``scored.coefficients``, terms end to end; a coefficient
    at one of its bounds counts as known. ``precision`` is that of the ordinary errors' priors, shape (Q,).
    """
    sums, weights = sums_of(board), weights_of(board, scored.held_out, scored.explained)
    q = sums.size
    own = cho_solve(sums.system(sums.total, weights, precision), np.eye(q), check_finite=False)
    if not scored.terms:
        return np.asarray(own)
    tried, _ = _tried(board, scored)
    beta = np.concatenate(scored.coefficients)
    low, high = bounds([t.effect for t in scored.terms])
    free = np.flatnonzero((beta > low) & (beta < high))
    mixed = sums.mixed(tried.by_row, weights)[:, free]
    moved = own @ mixed
    reduced = np.tensordot(weights, tried.own, 1)[np.ix_(free, free)] - mixed.T @ moved
    inner = np.linalg.pinv(reduced, hermitian=True)
    out = np.zeros((q + len(beta), q + len(beta)))
    out[:q, :q] = own + moved @ inner @ moved.T
    out[:q, q + free] = -moved @ inner
    out[q + free, :q] = out[:q, q + free].T
    out[np.ix_(q + free, q + free)] = inner
    return out


def _tried(board: Evidence, scored: Scored) -> tuple[ColumnProducts, list[ColumnProducts]]:
    columns = term_columns(board, scored.terms)
    base = [board.products(n, x) for n, x in enumerate(columns)]
    return products_by_fold(base, [board.products_of(n, x, x) for n, x in enumerate(columns)])


ROUNDS: Final = 3
PRIOR_UNITS: Final = 2.0
FAR: Final = 3.0
MEDIAN_OF_SQUARES: Final = 0.455
"""Median of the square of a standard normal variable."""


def learn_scales(board: Evidence) -> None:
    """Set the board's usual sizes to this robot's; before anything else is scored on it."""
    published = board.ordinary.published
    for _ in range(ROUNDS):
        now = board.ordinary.scale / published
        error = null_of(board).pulls * now
        variance = np.diag(posterior_covariance(board, null_of(board))) * now**2
        wanted = now.copy()
        for kind in board.ordinary.kinds:
            alike = kind.alike
            for k in range(len(kind.chosen)):
                at = kind.columns(k)
                own = _scale(_apart(error[at[~alike]], kind) ** 2, variance[at[~alike]])
                wanted[at[~alike]] = own
                if alike.any():
                    is_common = ERROR_SCALES[kind.effect.name].alike >= 1.0
                    wanted[at[alike]] = _scale(error[at[alike]] ** 2, variance[at[alike]]) if is_common else own
        board.rescale(wanted / now)


def _apart(error: Array, kind: ErrorKind) -> Array:
    """Errors of the units about the mean of their type, as far as types have several units; shape as it comes."""
    members = np.array([s for s in kind.sets if 1 < s.sum() < len(error)] or [s for s in kind.sets if s.sum() > 1])
    out = error.copy()
    for own in members:
        n = int(own.sum())
        # As large as without the mean, in expectation.
        out[own] = (error[own] - error[own].mean()) * np.sqrt(n / (n - 1.0))
    return out


def _scale(squares: Array, variance: Array) -> float:
    typical = float(np.median(squares)) / MEDIAN_OF_SQUARES
    held = np.minimum(squares, FAR**2 * max(typical, 1e-6)) if len(squares) > 2 else squares
    found = (PRIOR_UNITS + float(np.sum(held + variance))) / (PRIOR_UNITS + len(squares))
    return float(np.clip(np.sqrt(found), NARROWEST, 1.0))
