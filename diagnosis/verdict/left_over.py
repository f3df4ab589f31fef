"""What a fit leaves in each channel beyond what fits of robots without a fault leave, and how likely that is unknown.

The larger of two sizes counts as nothing: noise, and what formulas may leave.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from diagnosis.channels import Array, Channel
from diagnosis.decision_constants import OUTSIDE
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.faultless import FAULTLESS, even_odds
from diagnosis.selection.scoring import Scored

SMALLEST: Final = 0.1
"""No signal counts as better explained than to a tenth of what may be left: a program is replayed to the bit."""


def left_over(board: Evidence, scored: Scored) -> dict[str, float]:
    """By channel, the logarithm of what is left of its worst signal over noise and what formulas leave.

    None where states are far apart: filters and delays then leave more than on the robots that are compared with.
    """
    if board.is_coarse:
        return {}
    over = over_usual(board, scored)
    return {str(c): float(over[n].max()) for c, n in board.by_channel.items()}


def over_usual(board: Evidence, scored: Scored) -> Array:
    """By block, the logarithm of the mean square that is left over what may be left; shape (B,)."""
    may = 1.0 + board.tolerance_square + board.relative_square * scored.explained
    return np.asarray(np.log(np.maximum(scored.left / may, SMALLEST)))


def nats_left(board: Evidence, scored: Scored) -> dict[Channel, float]:
    """By channel, what explaining the rest of it as well as on robots without a fault would add to the value, nats."""
    over = over_usual(board, scored)
    found = {}
    for channel, numbers in board.by_channel.items():
        usual = max(FAULTLESS.left[str(channel)].median, 0.0) if str(channel) in FAULTLESS.left else np.inf
        found[channel] = float(0.5 * np.sum(board.dof[numbers] * np.maximum(over[numbers] - usual, 0.0)))
    return found


def probability(found: Mapping[str, float]) -> float:
    """Probability of something unknown, from what is left by channel and by gap; as before any log, without either."""
    tails = [FAULTLESS.left[name].tail(value) for name, value in found.items() if name in FAULTLESS.left] or [1.0]
    odds = OUTSIDE / (1.0 - OUTSIDE) * even_odds(min(1.0, len(tails) * min(tails)))
    return odds / (1.0 + odds)
