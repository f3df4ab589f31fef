"""How far effects of a set could stand in for each other: what one explains, as the others' columns would have it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve

from diagnosis.channels.channel_view import Array
from diagnosis.selection.scoring import Scorer, sums_of


def likeness(scorer: Scorer) -> Array:
    """By pair of the scorer's terms, the share of what the first explains that the second could explain.

    Both beside the ordinary errors: with G = XᵀWX − XᵀWZ(ZᵀWZ + 1)⁻¹ZᵀWX of the terms' columns X, the ordinary errors Z
    and the weights W, and coefficients β, it is |P_j x_i β_i|² / |x_i β_i|² in the metric of G.

    Returns:
        Shape (T, T), 1 on the diagonal.
    """
    board, weights, sums = scorer.board, scorer.weights, sums_of(scorer.board)
    sizes = [len(c) for c in scorer.now.coefficients]
    gram, mixed = np.zeros((sum(sizes),) * 2), np.zeros((sum(sizes), sums.size))
    for number, (base, own) in enumerate(zip(scorer.own_base, scorer.own_own, strict=True)):
        gram += weights[number] * own.sum(axis=0)
        mixed[:, board.ordinary.numbers[number]] += weights[number] * base.sum(axis=0)[:, :-1]
    gram -= mixed @ cho_solve(sums.system(sums.total, weights), mixed.T)
    ends = np.cumsum(sizes)
    parts = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
    out = np.eye(len(sizes))
    for i, (mine, beta) in enumerate(zip(parts, scorer.now.coefficients, strict=True)):
        energy = float(beta @ gram[mine, mine] @ beta)
        for j, other in enumerate(parts):
            if i != j and energy > 0.0:
                along = gram[other, mine] @ beta
                out[i, j] = float(along @ np.linalg.pinv(gram[other, other], hermitian=True) @ along) / energy
    return np.clip(out, 0.0, 1.0)
