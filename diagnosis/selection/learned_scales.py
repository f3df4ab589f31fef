"""How far this robot's ordinary errors scatter, learned from its own logs: empirical Bayes over the units of each kind.

With γ the errors of n units of a kind in published sizes, and v their posterior variances, the kind's variance is
s² = (n₀ + Σ (γ² + v)) / (n₀ + n): expectation and maximisation in turn, with n₀ units of prior weight at the published
size. A unit far off the others counts as one at three robust deviations: it is for the search to say what it is.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.channel_view import Array
from diagnosis.decision_constants import NARROWEST
from diagnosis.selection.evidence import Board
from diagnosis.selection.scoring import null_of, posterior_variance

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
        squares = (null_of(board).pulls * now) ** 2
        variance = posterior_variance(board) * now**2
        wanted = now.copy()
        for kind in board.ordinary.kinds:
            for k in range(len(kind.chosen)):
                columns = kind.columns(k)
                alike = np.array([s.sum() > 1 for s in kind.sets]) & (len(kind.sets) > 1)
                for group in (alike, ~alike):
                    if group.any():
                        at = np.arange(len(squares))[columns][group]
                        wanted[at] = _scale(squares[at], variance[at])
        board.rescale(wanted / now)


def _scale(squares: Array, variance: Array) -> float:
    typical = float(np.median(squares)) / MEDIAN_OF_SQUARES
    held = np.minimum(squares, FAR**2 * max(typical, 1e-6)) if len(squares) > 2 else squares
    found = (PRIOR_UNITS + float(np.sum(held + variance))) / (PRIOR_UNITS + len(squares))
    return float(np.clip(np.sqrt(found), NARROWEST, 1.0))
