"""Effects that these logs cannot show, however large they are within reason."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_solve

from diagnosis.channels.channel_view import Array, Shape
from diagnosis.decision_constants import ERROR_SCALES, LEAST_NATS_TO_TRY
from diagnosis.library.base import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Board
from diagnosis.selection.scoring import Placed, null_of, sums_of
from diagnosis.selection.search import PER_PARAMETER

LARGEST_IN_SCALES = 10.0
"""Largest realistic size, in standard deviations of ordinary errors, where an entry names none: half the torque lost, a
tenth of a kilogram-metre squared, 5 kg, 3 degrees of an encoder."""


def cannot_show(board: Board, library: Mapping[str, LibraryEffect] = LIBRARY) -> tuple[str, ...]:
    """Names of effects that show in no channel, or too little to be told from ordinary errors.

    An effect of its largest realistic size at all joints is expected to bring ½·xᵀ(W − W·Z(ZᵀWZ + 1)⁻¹ZᵀW)x nats, with
    Z the ordinary errors and W what a sample counts; the search asks for :data:`LEAST_NATS_TO_TRY` and the price of
    its numbers. Effects whose size is in their shape are sought where the logs have them: only a channel decides.
    """
    return tuple(name for name, effect in library.items() if not _can_show(board, effect))


def _can_show(board: Board, effect: LibraryEffect) -> bool:
    if not effect.show(board.views):
        return False
    if not all(c.is_free for c in effect.coefficients):
        return True
    shapes = effect.shapes(board.views, np.ones(board.robot.n_joints, dtype=np.bool_))
    if not shapes:
        return False
    asked = LEAST_NATS_TO_TRY + PER_PARAMETER * Placed(effect, shapes[0], np.ones(1)).n_parameters
    return any(expected_nats(board, effect, shape) >= asked for shape in shapes)


def expected_nats(board: Board, effect: LibraryEffect, shape: Shape) -> float:
    """What the effect brings at its largest realistic size, the coefficient that shows best alone.

    Args:
        board: The evidence, with its ordinary errors.
        effect: All of whose coefficients are free.
        shape: Of the effect.
    """
    columns, null, sums = board.columns(effect, shape), null_of(board), sums_of(board)
    weights = board.dof / (null.held_out + board.tolerance_square + board.relative_square * null.explained)
    size = largest(effect)
    gram, mixed = np.zeros(len(size)), np.zeros((board.ordinary.size, len(size)))
    for number, x in enumerate(columns.x):
        if x.shape[1]:
            whole = x.sum(axis=1).astype(np.float64) * size
            squares = board.products_of(number, whole, whole).sum(axis=0)
            gram += weights[number] * np.diag(squares)
            with_errors = board.products(number, whole).sum(axis=0)[:, :-1]
            mixed[board.ordinary.numbers[number]] += weights[number] * with_errors.T
    taken = np.sum(mixed * cho_solve(sums.system(sums.total, weights), mixed), axis=0)
    return float(np.max(0.5 * (gram - taken), initial=0.0))


def largest(effect: LibraryEffect) -> Array:
    """Largest realistic size of each coefficient, within its bounds. Shape (C,)."""
    usual = ERROR_SCALES[effect.name].scales if effect.name in ERROR_SCALES else {}
    bounds = [max(abs(c.low), abs(c.high)) for c in effect.coefficients]
    asked = [effect.largest.get(c.name, LARGEST_IN_SCALES * usual.get(c.name, np.inf)) for c in effect.coefficients]
    return np.minimum(bounds, asked)
