"""Fit several effects at given places and shapes, and score them on folds that the fit never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from diagnosis.library.base import LibraryEffect
from diagnosis.seam import Array, Ints, Shape
from diagnosis.selection.board import Board, Columns
from diagnosis.selection.solve import solve_bounded

OUTLIER: Final = 12.0
"""A residual counts as no more than so many of its row's scales."""


@dataclass(frozen=True)
class Placed:
    """One effect with a shape at a set of units."""

    effect: LibraryEffect
    shape: Shape
    place: Array
    """Shape (U,), 0 or 1."""

    @property
    def n_parameters(self) -> int:
        """Free numbers."""
        return sum(c.low < c.high for c in self.effect.coefficients) + len(self.shape)


@dataclass(frozen=True)
class Scored:
    """A set of effects, fitted."""

    terms: tuple[Placed, ...]
    coefficients: tuple[Array, ...]
    """By term; fitted to all folds."""
    spread: Array
    """By fold and parameter: coefficients fitted without the fold, shape (F, K), terms end to end."""
    score: float
    """Log-likelihood of the folds that the fit never saw, in nats, against none of the effects."""
    by_block: Array
    """The same by block, shape (B,)."""
    held_out: Array
    """Mean square of each block's residual in folds that the fit never saw, units of the noise. Shape (B,)."""


def bounds(effects: Sequence[LibraryEffect]) -> tuple[Array, Array]:
    """Bounds of all coefficients, end to end."""
    cs = [c for e in effects for c in e.coefficients]
    return np.array([c.low for c in cs], dtype=np.float64), np.array([c.high for c in cs], dtype=np.float64)


class Scorer:
    """Scores candidates on a board, beside terms that are already in."""

    def __init__(self, board: Board, terms: Sequence[Placed] = ()) -> None:
        """Choose what is already in."""
        self.board = board
        self.terms = tuple(terms)
        self.own = self._summed(terms)
        self.null = self._mean_square([b.y for b in board.blocks])
        self.low, self.high = bounds([t.effect for t in terms])
        base = self._residuals(self.terms)
        self.weights = [self._weight(r) for r in base]
        self.variance = self._mean_square(base) + np.array([b.tolerance**2 for b in board.blocks])
        self._grams: dict[tuple[object, ...], tuple[tuple[Array, Ints], ...]] = {}

    def _summed(self, terms: Sequence[Placed]) -> list[Array]:
        """By block, the columns of all terms, shape (m, K)."""
        parts: list[list[Array]] = [[] for _ in self.board.blocks]
        for term in terms:
            columns = self.board.columns(term.effect, term.shape)
            for number in range(len(self.board.blocks)):
                parts[number].append(place_columns(columns, number, term.place))
        return [
            np.concatenate(p, axis=1) if p else np.zeros((len(b.y), 0))
            for p, b in zip(parts, self.board.blocks, strict=True)
        ]

    def _mean_square(self, residuals: Sequence[Array]) -> Array:
        return np.array([float(np.mean(r**2)) for r in residuals])

    @staticmethod
    def _weight(residual: Array) -> Array:
        scale = max(1.0, float(np.sqrt(np.mean(np.minimum(residual**2, 100.0 * np.median(residual**2) + 1.0)))))
        return np.asarray(np.minimum(1.0, OUTLIER * scale / np.maximum(np.abs(residual), 1e-12)))

    def _residuals(self, terms: Sequence[Placed]) -> list[Array]:
        if not terms:
            return [b.y for b in self.board.blocks]
        residuals = [b.y for b in self.board.blocks]
        for _ in range(2):
            variance = self._mean_square(residuals) + np.array([b.tolerance**2 for b in self.board.blocks])
            gram = sum(x.T @ x / v for x, v in zip(self.own, variance, strict=True))
            right = sum(x.T @ b.y / v for x, b, v in zip(self.own, self.board.blocks, variance, strict=True))
            beta = solve_bounded(np.asarray(gram), np.asarray(right), self.low, self.high)
            residuals = [b.y - x @ beta for x, b in zip(self.own, self.board.blocks, strict=True)]
        return residuals

    def residuals(self) -> list[Array]:
        """What the terms leave in each block, fitted to all folds."""
        return self._residuals(self.terms)

    def grams(self, effect: LibraryEffect, shape: Shape) -> tuple[tuple[Array, Ints], ...]:
        """By block and fold the products of [terms, units of the candidate, y]: shape (F, K, K), and the units."""
        key = (effect.name, *sorted(shape.items()))
        if key not in self._grams:
            if len(self._grams) > 64:
                self._grams.clear()
            columns = self.board.columns(effect, shape)
            found = []
            for number, block in enumerate(self.board.blocks):
                x = columns.x[number]
                z = np.concatenate([self.own[number], x.reshape(len(x), -1), block.y[:, None]], axis=1)
                z = z * np.sqrt(self.weights[number])[:, None]
                products = np.stack([z[block.fold == f].T @ z[block.fold == f] for f in range(self.board.n_folds)])
                found.append((products, columns.units[number]))
            self._grams[key] = tuple(found)
        return self._grams[key]

    def scores(self, effect: LibraryEffect, shape: Shape, places: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Score the candidate at each place.

        Args:
            effect: The candidate.
            shape: Its shape.
            places: Shape (L, U).

        Returns:
            Score (L,), score by block (L, B), coefficients fitted to all folds (L, K), those without each fold
            (L, F, K), held-out mean square by block (L, B).
        """
        size, own = len(effect.coefficients), len(self.low)
        low, high = bounds([effect])
        low, high = np.concatenate([self.low, low]), np.concatenate([self.high, high])
        k = own + size
        grams = self.grams(effect, shape)
        full = np.stack([_placed(g, units, places, own, size) for g, units in grams])  # (B, L, F, k+1, k+1)
        counts = np.array([[np.sum(b.fold == f) for f in range(self.board.n_folds)] for b in self.board.blocks])
        variance = np.repeat(self.variance[:, None], len(places), axis=1)
        total = full.sum(axis=2)
        tolerance = np.array([b.tolerance**2 for b in self.board.blocks])[:, None]
        for _ in range(2):
            summed = np.einsum("bl,blij->lij", 1.0 / variance, total)
            beta = solve_bounded(summed[:, :k, :k], summed[:, :k, k], low, high)
            square = _square(total, beta[None]) / counts.sum(axis=1)[:, None]
            variance = np.maximum(square, 1e-6) + tolerance + 1e-9
        summed = np.einsum("bl,blfij->lfij", 1.0 / variance, total[:, :, None] - full)
        without = solve_bounded(summed[..., :k, :k], summed[..., :k, k], low, high)
        held_out = _square(full, without[None]).sum(axis=2) / counts.sum(axis=1)[:, None]
        independent = np.array([b.n_independent for b in self.board.blocks])[:, None]
        null = total[..., -1, -1] / counts.sum(axis=1)[:, None]
        by_block = 0.5 * independent * np.log((null + tolerance + 1.0) / (held_out + tolerance + 1.0))
        return by_block.sum(axis=0), by_block.T, beta, without, held_out.T

    def scored(self, effect: LibraryEffect, shape: Shape, place: Array) -> Scored:
        """The terms and one candidate, fitted."""
        score, by_block, beta, without, held_out = self.scores(effect, shape, place[None])
        terms = (*self.terms, Placed(effect, shape, place))
        parts, at = [], 0
        for term in terms:
            size = len(term.effect.coefficients)
            parts.append(beta[0, at : at + size])
            at += size
        return Scored(terms, tuple(parts), without[0], float(score[0]), by_block[0], held_out[0])


def place_columns(columns: Columns, number: int, place: Array) -> Array:
    """Columns of a block at a set of units, shape (m, P)."""
    x = columns.x[number]
    return np.asarray(np.einsum("mup,u->mp", x, place[columns.units[number]]))


def _placed(products: Array, units: Ints, places: Array, own: int, size: int) -> Array:
    """Products of [terms, candidate at each place, y], shape (L, F, K, K) with K = own + size + 1."""
    n_units = len(units)
    small, large = own + size + 1, own + n_units * size + 1
    spread = np.zeros((len(places), large, small))
    spread[:, :own, :own] = np.eye(own)
    spread[:, -1, -1] = 1.0
    for i, unit in enumerate(units):
        for p in range(size):
            spread[:, own + i * size + p, own + p] = places[:, unit]
    return np.asarray(np.swapaxes(spread, 1, 2)[:, None] @ products[None] @ spread[:, None])


def _square(products: Array, beta: Array) -> Array:
    """Sum of squared residuals y − Xb from products (..., k+1, k+1) and coefficients (..., k)."""
    b = np.concatenate([-beta, np.ones((*beta.shape[:-1], 1))], axis=-1)
    return np.asarray(np.maximum(np.einsum("...i,...ij,...j->...", b, products, b), 0.0))
