"""The blocks' normal equations laid end to end: to weight and to solve them is a few products, not a loop over blocks.

A block has a column for each ordinary error that shows in it, then those of the effects that are tried, then y. The
products of the first and the last stay as they are whatever is tried; :class:`OrdinarySums` keeps them, by fold.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from diagnosis.channels import Array, Ints

Factor = tuple[Array, bool]


def one_thread() -> AbstractContextManager[object]:
    """Within it, linear algebra runs on one thread: threads that share small matrices wait longer than they compute."""
    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


@dataclass(frozen=True)
class OrdinaryPart:
    """Products of ordinary errors and y, by block, over some folds."""

    pairs: Any
    """Products of two ordinary errors, the first not after the second: sparse, shape (B, Q·Q)."""
    transposed: Any
    with_y: Array
    """Shape (B, Q)."""
    yy: Array
    """Shape (B,)."""

    def __sub__(self, other: OrdinaryPart) -> OrdinaryPart:
        pairs = self.pairs - other.pairs
        return OrdinaryPart(pairs, pairs.T, self.with_y - other.with_y, self.yy - other.yy)


class OrdinarySums:
    """What is the same whatever is tried.

    Args:
        numbers: By block: which of the Q its ordinary errors are.
        size: Q.
        base: By block and fold the products of [ordinary errors, y], shape (F, q + 1, q + 1).
    """

    def __init__(self, numbers: Sequence[Ints], size: int, base: Sequence[Array]) -> None:
        self.size, self.n_blocks = size, len(numbers)
        counts = np.array([len(n) for n in numbers], dtype=np.intp)
        self.rows: Ints = np.concatenate([np.zeros(0, dtype=np.intp), *numbers]).astype(np.intp)
        """Ordinary error of each of the blocks' columns, end to end, shape (q_all,)."""
        self.block_of_row: Ints = np.repeat(np.arange(self.n_blocks), counts)
        ones = np.ones(len(self.rows))
        places = (self.rows, np.arange(len(self.rows)))
        self.gather = csr_array((ones, places), shape=(size, len(self.rows)))
        self.by_block = csr_array((ones, (self.block_of_row, places[1])), shape=(self.n_blocks, len(self.rows)))
        self._twice = np.triu(np.full((size, size), 2.0)) - np.eye(size)
        upper = [np.triu_indices(n) for n in counts]
        flat = [
            np.minimum(at[i], at[j]) * size + np.maximum(at[i], at[j])
            for at, (i, j) in zip(numbers, upper, strict=True)
        ]
        self._columns = np.concatenate([np.zeros(0, dtype=np.intp), *flat])
        self._starts = np.concatenate([[0], np.cumsum([len(f) for f in flat])]).astype(np.intp)
        pairs = np.concatenate([b[:, i, j] for b, (i, j) in zip(base, upper, strict=True)], axis=1)
        with_y = np.zeros((len(pairs), self.n_blocks, size))
        for number, (at, b) in enumerate(zip(numbers, base, strict=True)):
            with_y[:, number, at] = b[:, :-1, -1]
        yy = np.stack([b[:, -1, -1] for b in base], axis=1)
        self.total = self._part(pairs.sum(axis=0), with_y.sum(axis=0), yy.sum(axis=0))
        self.folds = [self._part(*own) for own in zip(pairs, with_y, yy, strict=True)]

    def _part(self, pairs: Array, with_y: Array, yy: Array) -> OrdinaryPart:
        sparse = csr_array((pairs, self._columns, self._starts), shape=(self.n_blocks, self.size**2))
        return OrdinaryPart(sparse, sparse.T, with_y, yy)

    def system(self, part: OrdinaryPart, weights: Array) -> Factor:
        """The ordinary errors' own weighted problem, in published spreads, factored."""
        system = (part.transposed @ weights).reshape(self.size, self.size)
        system.flat[:: self.size + 1] += 1.0
        factored: Factor = cho_factor(system, overwrite_a=True, check_finite=False)
        return factored

    def mixed(self, by_row: Array, weights: Array) -> Array:
        """Weighted products of ordinary errors and columns, (q_all, k) to (Q, k)."""
        return np.asarray(self.gather @ (weights[self.block_of_row][:, None] * by_row))

    def left(self, part: OrdinaryPart, tried: ColumnProducts, pulls: Array, beta: Array) -> Array:
        """By block, the sum of squares that is left."""
        by_ordinary = part.pairs @ (np.outer(pulls, pulls) * self._twice).ravel()
        both = self.by_block @ (pulls[self.rows] * (tried.by_row @ beta))
        by_tried = np.einsum("bij,i,j->b", tried.own, beta, beta)
        crossed = part.with_y @ pulls + tried.with_y @ beta
        return np.asarray(np.maximum(by_ordinary + 2.0 * both + by_tried - 2.0 * crossed + part.yy, 0.0))


@dataclass(frozen=True)
class ColumnProducts:
    """Products of the columns that are tried, k of them, over some folds."""

    by_row: Array
    """With the blocks' ordinary errors, end to end, shape (q_all, k)."""
    with_y: Array
    """Shape (B, k)."""
    own: Array
    """Shape (B, k, k)."""

    @staticmethod
    def of(base: Sequence[Array], both: Sequence[Array]) -> ColumnProducts:
        """From the blocks' products of the columns with [ordinary errors, y], (k, q + 1), and with each other."""
        return ColumnProducts(
            np.concatenate([b[:, :-1].T for b in base]), np.stack([b[:, -1] for b in base]), np.stack(both)
        )

    def __sub__(self, other: ColumnProducts) -> ColumnProducts:
        return ColumnProducts(self.by_row - other.by_row, self.with_y - other.with_y, self.own - other.own)


def solved(
    sums: OrdinarySums, part: OrdinaryPart, tried: ColumnProducts, weights: Array, low: Array, high: Array, held: Array
) -> tuple[Array, Array, Array]:
    """One weighted problem; ``held`` is the precision of the coefficients' priors, shape (k,).

    Returns:
        Ordinary errors (Q,), coefficients (k,), and the information about these that the former leave (k, k).
    """
    k = len(low)
    factor = sums.system(part, weights)
    right = weights @ part.with_y
    if k == 0:
        return np.asarray(cho_solve(factor, right, check_finite=False)), np.zeros(0), np.zeros((0, 0))
    mixed = sums.mixed(tried.by_row, weights)
    found = cho_solve(factor, np.concatenate([mixed, right[:, None]], axis=1), check_finite=False)
    information = np.tensordot(weights, tried.own, 1) - mixed.T @ found[:, :k]
    target = weights @ tried.with_y - mixed.T @ found[:, k]
    beta = solve_bounded(information + np.diag(held), target, low, high)
    return np.asarray(found[:, k] - found[:, :k] @ beta), beta, information


def solve_bounded(gram: Array, right: Array, low: Array, high: Array) -> Array:
    """Minimise ½ bᵀGb − rᵀb within bounds.

    Args:
        gram: Shape (..., k, k), symmetric, positive semi-definite.
        right: Shape (..., k).
        low: Shape (k,).
        high: Shape (k,), may equal ``low``.

    Returns:
        Shape (..., k). A column of zeros gets the bound nearest to 0.
    """
    k = gram.shape[-1]
    if k == 0:
        return np.zeros_like(right)
    diagonal = np.einsum("...ii->...i", gram)
    scale = np.sqrt(np.maximum(diagonal, 1e-30))
    unit = gram / (scale[..., :, None] * scale[..., None, :]) + 1e-9 * np.eye(k)
    target = right / scale
    b_low, b_high = low * scale, high * scale
    b = np.linalg.solve(unit, target[..., None])[..., 0]
    if np.all((b >= b_low) & (b <= b_high)):
        return np.asarray(b / scale)
    b = np.clip(b, b_low, b_high)
    for _ in range(60):
        before = b.copy()
        for i in range(k):
            slope = target[..., i] - np.einsum("...j,...j->...", unit[..., i, :], b)
            b[..., i] = np.clip(b[..., i] + slope / unit[..., i, i], b_low[..., i], b_high[..., i])
        if np.max(np.abs(b - before)) < 1e-7 * (1.0 + np.max(np.abs(b))):
            break
    return np.asarray(b / scale)
