"""How far this robot's ordinary errors scatter, learned from its own logs: empirical Bayes over the units of each kind.

With γ the errors of n units of a kind in published sizes, about what units of a type have in common, and v their
posterior variances, the kind's variance is s² = (n₀ + Σ (γ² + v)) / (n₀ + n): expectation and maximisation in turn,
with n₀ units of prior weight at the published size. A unit far off the others counts as one at three robust
deviations: it is for the search to say what it is.

What units have in common is one number, and teaches no scale. It is expected to be as small, beside its published
range, as the units' own scatter: a robot whose joints differ by one per cent is hardly off by ten at all of them.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.channel_view import Array
from diagnosis.decision_constants import ERROR_SCALES, NARROWEST
from diagnosis.selection.calibrated import posterior_covariance
from diagnosis.selection.evidence import Board
from diagnosis.selection.nuisance import ErrorKind
from diagnosis.selection.scoring import null_of

ROUNDS: Final = 3
PRIOR_UNITS: Final = 2.0
FAR: Final = 3.0
MEDIAN_OF_SQUARES: Final = 0.455
"""Of a standard normal variable."""


def learn_scales(board: Board) -> None:
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
