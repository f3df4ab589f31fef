"""Effects that these logs cannot show, however large they are within reason."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_solve

from diagnosis.channels.channel_view import Array, Shape
from diagnosis.decision_constants import ERROR_SCALES, LEAST_NATS_TO_TRY, ErrorScale
from diagnosis.library.base import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Board
from diagnosis.selection.scoring import Scorer, sums_of

LARGEST_IN_SCALES = 10.0
"""Largest realistic size, in standard deviations of ordinary errors, where an entry names none: half the torque lost,
2 N·m of friction or of a zero, 5 kg, 3 degrees of an encoder."""


def cannot_show(board: Board, library: Mapping[str, LibraryEffect] = LIBRARY) -> tuple[str, ...]:
    """Names of effects that show in no channel, or too little to be told from ordinary errors.

    An effect of its largest realistic size is expected to bring ½·xᵀ(W − W·Z(ZᵀWZ + 1)⁻¹ZᵀW)x nats, with Z the ordinary
    errors and W what a sample counts; the search tries none that brings fewer than :data:`LEAST_NATS_TO_TRY`. Effects
    whose size is in their shape are sought where the logs have them: only a channel decides.
    """
    scorer = Scorer(board)
    return tuple(name for name, effect in library.items() if not _can_show(scorer, effect))


def _can_show(scorer: Scorer, effect: LibraryEffect) -> bool:
    board = scorer.board
    if not effect.show(board.views):
        return False
    if not all(c.is_free for c in effect.coefficients):
        return True
    shapes = effect.shapes(board.views, np.ones(board.robot.n_joints, dtype=np.bool_))
    return any(expected_nats(scorer, effect, shape) >= LEAST_NATS_TO_TRY for shape in shapes)


def expected_nats(scorer: Scorer, effect: LibraryEffect, shape: Shape) -> float:
    """What the effect brings at its largest realistic size: the best coefficient at the best unit, or at all of them.

    Args:
        scorer: Of the ordinary errors alone.
        effect: All of whose coefficients are free.
        shape: Of the effect.
    """
    board, sums = scorer.board, sums_of(scorer.board)
    columns, size = board.columns(effect, shape), largest(effect)
    n_units = len(board.robot.units(effect.location))
    gram = np.zeros((n_units * len(size),) * 2)
    mixed = np.zeros((sums.size, len(gram)))
    for number, part in enumerate(scorer.crosses(effect, shape)):
        if part is not None:
            at = (columns.units[number][:, None] * len(size) + np.arange(len(size))).ravel()
            gram[at[:, None], at] += scorer.weights[number] * part.whole_own
            mixed[board.ordinary.numbers[number][:, None], at] += scorer.weights[number] * part.whole_base[:, :-1].T
    gram -= mixed.T @ cho_solve(sums.system(sums.total, scorer.weights), mixed)
    by_pair = gram.reshape(n_units, len(size), n_units, len(size))
    alone, together = np.einsum("ukuk->uk", by_pair), np.einsum("ukvk->k", by_pair)
    return float(np.max(0.5 * size**2 * np.concatenate([alone, together[None]])))


def largest(effect: LibraryEffect) -> Array:
    """Largest realistic size of each coefficient, within its bounds. Shape (C,)."""
    given = ERROR_SCALES.get(effect.name, ErrorScale({}))
    times = LARGEST_IN_SCALES * max(1.0, given.alike)
    asked = [effect.largest.get(c.name, times * given.scales.get(c.name, np.inf)) for c in effect.coefficients]
    return np.minimum([max(abs(c.low), abs(c.high)) for c in effect.coefficients], asked)
