"""Fit several effects at given places and shapes beside the ordinary errors, and score them on folds never seen.

A model's value is −½ Σ D log(m + t²) − ½ |γ|²: over the blocks, with m the mean square of the residual in folds that
the fit never saw (units of the noise), t the tolerance, D the number of independent ways in which a formula that is not
quite the truth can be off; and γ the ordinary errors in units of their usual sizes. More data make m exact, but do not
make a formula truer, so D does not grow with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from diagnosis.library.base import LibraryEffect
from diagnosis.seam import Array, Ints, Shape
from diagnosis.selection.board import Board, Columns
from diagnosis.selection.solve import solve_bounded

ROUNDS: Final = 4
"""Rounds of weights and fit: weights follow the residuals."""


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
        return sum(c.low < c.high for c in self.effect.coefficients) + (self.effect.n_free or len(self.shape))


@dataclass(frozen=True)
class Scored:
    """A set of effects, fitted."""

    terms: tuple[Placed, ...]
    coefficients: tuple[Array, ...]
    """By term; fitted to all folds."""
    spread: Array
    """By fold and parameter: coefficients fitted without the fold, shape (F, K), terms end to end."""
    score: float
    """Value against none of the effects, in nats."""
    by_block: Array
    """The same by block, without what the ordinary errors cost. Shape (B,)."""
    held_out: Array
    """Mean square of each block's residual in folds that the fit never saw, units of the noise. Shape (B,)."""
    pulls: Array
    """Ordinary errors in units of their usual sizes. Shape (Q,)."""
    explained: Array
    """Mean square of what terms and ordinary errors explain in each block, units of the noise. Shape (B,)."""


@dataclass(frozen=True)
class _Fitted:
    beta: Array
    pulls: Array
    spread: Array
    held_out: Array
    explained: Array
    weights: Array


def bounds(effects: Sequence[LibraryEffect]) -> tuple[Array, Array]:
    """Bounds of all coefficients, end to end."""
    cs = [c for e in effects for c in e.coefficients]
    return np.array([c.low for c in cs], dtype=np.float64), np.array([c.high for c in cs], dtype=np.float64)


@dataclass(frozen=True)
class _Cross:
    """Products of one block's columns of a candidate: with [ordinary, y] and with themselves, by fold."""

    base: Array
    """Shape (F, uP, q + 1)."""
    own: Array
    """Shape (F, uP, uP)."""


class Scorer:
    """Scores candidates on a board, beside terms that are already in."""

    def __init__(self, board: Board, terms: Sequence[Placed] = ()) -> None:
        """Choose what is already in."""
        self.board = board
        self.terms = tuple(terms)
        self.low, self.high = bounds([t.effect for t in terms])
        self.own = [
            np.concatenate(
                [
                    np.zeros((len(b.y), 0)),
                    *(place_columns(board.columns(t.effect, t.shape), n, t.place) for t in terms),
                ],
                axis=1,
            )
            for n, b in enumerate(board.blocks)
        ]
        self.own_base = [board.products(n, x) for n, x in enumerate(self.own)]
        self.own_own = [board.products_of(n, x, x) for n, x in enumerate(self.own)]
        self._own_cross: dict[tuple[object, ...], list[Array]] = {}
        fitted = self._fit(self.own_base, self.own_own, self.low, self.high)
        self.weights = fitted.weights
        self.now = self._scored(self.terms, fitted)

    # ---- one model, exactly

    def scored(self, effect: LibraryEffect, shape: Shape, place: Array) -> Scored:
        """The terms and one candidate, fitted."""
        return self.with_weights(effect, shape, place)[0]

    def with_weights(self, effect: LibraryEffect, shape: Shape, place: Array) -> tuple[Scored, Array]:
        """The same, and the blocks' weights that belong to it."""
        columns = self.board.columns(effect, shape)
        cross, own = self.crosses(effect, shape), self._crosses_with_own(effect, shape)
        size = len(effect.coefficients)
        base, both = [], []
        for number in range(len(self.board.blocks)):
            units, part = columns.units[number], cross[number]
            if part is None:
                base.append(_padded(self.own_base[number], size, 1))
                both.append(_padded(_padded(self.own_own[number], size, 1), size, 2))
                continue
            spread = _spread(place[units], size)
            base.append(np.concatenate([self.own_base[number], spread.T @ part.base], axis=1))
            mixed = own[number] @ spread
            top = np.concatenate([self.own_own[number], mixed], axis=2)
            low = np.concatenate([np.swapaxes(mixed, 1, 2), spread.T @ part.own @ spread], axis=2)
            both.append(np.concatenate([top, low], axis=1))
        low_bound, high_bound = bounds([effect])
        low, high = np.concatenate([self.low, low_bound]), np.concatenate([self.high, high_bound])
        fitted = self._fit(base, both, low, high)
        return self._scored((*self.terms, Placed(effect, shape, place)), fitted), fitted.weights

    def residuals(self, cap: float = np.inf) -> list[Array]:
        """What the terms and the ordinary errors leave in each block, those held to so many usual sizes."""
        pulls = np.clip(self.now.pulls, -cap, cap)
        ordinary = self.board.ordinary
        beta = np.concatenate([np.zeros(0), *self.now.coefficients])
        return [
            b.y - x @ beta - z @ pulls[numbers]
            for b, x, z, numbers in zip(self.board.blocks, self.own, ordinary.x, ordinary.numbers, strict=True)
        ]

    def _fit(self, base: list[Array], both: list[Array], low: Array, high: Array) -> _Fitted:
        board = self.board
        joined = [_joined(board.base[n], base[n], both[n]) for n in range(len(board.blocks))]
        totals = [j.sum(axis=0) for j in joined]
        weights = board.dof / (np.array([t[-1, -1] for t in totals]) + board.tolerance_square)
        explained = np.zeros(len(board.blocks))
        for _ in range(ROUNDS):
            pulls, beta = self._solve(totals, weights, low, high)
            left, explained = self._squares(totals, pulls, beta)
            weights = board.dof / (left + board.tolerance_square + board.relative_square * explained)
        pulls, beta = self._solve(totals, weights, low, high)
        _, explained = self._squares(totals, pulls, beta)
        held_out = np.zeros(len(board.blocks))
        spread = np.zeros((board.n_folds, len(low)))
        for fold in range(board.n_folds):
            others, spread[fold] = self._solve(
                [t - j[fold] for t, j in zip(totals, joined, strict=True)], weights, low, high
            )
            held_out += self._squares([j[fold] for j in joined], others, spread[fold])[0]
        return _Fitted(beta, pulls, spread, held_out, explained, weights)

    def _solve(self, grams: list[Array], weights: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Ordinary errors (Q,) and coefficients (k,) of one weighted problem."""
        q_all, k = self.board.ordinary.size, len(low)
        system = np.eye(q_all)
        mixed, right = np.zeros((q_all, k)), np.zeros(q_all)
        own, own_right = np.zeros((k, k)), np.zeros(k)
        for number, (gram, weight) in enumerate(zip(grams, weights, strict=True)):
            at = self.board.ordinary.numbers[number]
            q = len(at)
            if q:
                system[at[:, None], at] += weight * gram[:q, :q]
                right[at] += weight * gram[:q, -1]
                if k:
                    mixed[at] += weight * gram[:q, q : q + k]
            own += weight * gram[q : q + k, q : q + k]
            own_right += weight * gram[q : q + k, -1]
        factor = cho_factor(system)
        if k == 0:
            return cho_solve(factor, right), np.zeros(0)
        solved = cho_solve(factor, np.concatenate([mixed, right[:, None]], axis=1))
        reduced = own - mixed.T @ solved[:, :k]
        beta = solve_bounded(reduced, own_right - mixed.T @ solved[:, k], low, high)
        return solved[:, k] - solved[:, :k] @ beta, beta

    def _squares(self, grams: list[Array], pulls: Array, beta: Array) -> tuple[Array, Array]:
        """By block: sum of squares that is left, and that all columns explain; over the samples of the block."""
        left, explained = np.zeros(len(grams)), np.zeros(len(grams))
        for number, gram in enumerate(grams):
            at = self.board.ordinary.numbers[number]
            vector = np.concatenate([-pulls[at], -beta, [1.0]])
            left[number] = max(0.0, float(vector @ gram @ vector))
            # Ordinary errors too are formulas: what they explain is as uncertain as what an effect explains.
            vector[-1] = 0.0
            explained[number] = max(0.0, float(vector @ gram @ vector))
        return left, explained

    def _scored(self, terms: tuple[Placed, ...], fitted: _Fitted) -> Scored:
        board = self.board
        tolerance = board.tolerance_square + board.relative_square * fitted.explained
        by_block = -0.5 * board.dof * np.log(fitted.held_out + tolerance)
        cost = 0.5 * float(fitted.pulls @ fitted.pulls)
        if terms:
            null = null_of(board)
            by_block = by_block - null.by_block
            cost -= 0.5 * float(null.pulls @ null.pulls)
        parts, at = [], 0
        for term in terms:
            size = len(term.effect.coefficients)
            parts.append(fitted.beta[at : at + size])
            at += size
        score = float(by_block.sum()) - cost
        return Scored(
            terms, tuple(parts), fitted.spread, score, by_block, fitted.held_out, fitted.pulls, fitted.explained
        )

    # ---- many places at once, with weights that are given

    def crosses(self, effect: LibraryEffect, shape: Shape) -> list[_Cross | None]:
        """By block the products of a candidate's columns; kept on the board."""
        key = ("cross", effect.name, *sorted(shape.items()))
        if key not in self.board.kept:
            columns = self.board.columns(effect, shape)
            found: list[_Cross | None] = []
            for number, x in enumerate(columns.x):
                flat = x.reshape(len(x), -1)
                found.append(
                    _Cross(self.board.products(number, flat), self.board.products_of(number, flat, flat))
                    if flat.shape[1]
                    else None
                )
            self.board.kept[key] = found
        kept: list[_Cross | None] = self.board.kept[key]
        return kept

    def _crosses_with_own(self, effect: LibraryEffect, shape: Shape) -> list[Array]:
        """By block the products of the terms' columns and the candidate's, shape (F, K, uP)."""
        key = (effect.name, *sorted(shape.items()))
        if key not in self._own_cross:
            columns = self.board.columns(effect, shape)
            self._own_cross[key] = [
                self.board.products_of(number, self.own[number], x.reshape(len(x), -1))
                for number, x in enumerate(columns.x)
            ]
        return self._own_cross[key]

    def gains(self, effect: LibraryEffect, shape: Shape, places: Array, weights: Array) -> Array:
        """What the candidate takes off the weighted squares at each place (L, U) beside the terms; shape (L,), nats."""
        board, columns = self.board, self.board.columns(effect, shape)
        cross, with_own = self.crosses(effect, shape), self._crosses_with_own(effect, shape)
        size, n_units, k = len(effect.coefficients), places.shape[1], len(self.low)
        width = k + n_units * size
        gram, mixed = np.zeros((width, width)), np.zeros((width, board.ordinary.size))
        right = np.zeros(width)
        factor, right_ordinary, own_gram, own_mixed, own_right = self._weighted(weights)
        gram[:k, :k], mixed[:k], right[:k] = own_gram, own_mixed, own_right
        for number, part in enumerate(cross):
            if part is None:
                continue
            at = board.ordinary.numbers[number]
            columns_at = k + (columns.units[number][:, None] * size + np.arange(size)).ravel()
            base = weights[number] * part.base.sum(axis=0)
            right[columns_at] += base[:, -1]
            mixed[columns_at[:, None], at] += base[:, :-1]
            gram[columns_at[:, None], columns_at] += weights[number] * part.own.sum(axis=0)
            if k:
                both = weights[number] * with_own[number].sum(axis=0)
                gram[np.arange(k)[:, None], columns_at] += both
                gram[columns_at[:, None], np.arange(k)] += both.T
        solved = cho_solve(factor, np.concatenate([mixed.T, right_ordinary[:, None]], axis=1))
        gram = gram - mixed @ solved[:, :-1]
        right = right - mixed @ solved[:, -1]
        spread = np.zeros((len(places), width, k + size))
        spread[:, :k, :k] = np.eye(k)
        for p in range(size):
            spread[:, k + p :: size, k + p] = places
        turned = np.swapaxes(spread, 1, 2)
        small, small_right = turned @ gram @ spread, np.asarray(turned @ right)
        low, high = bounds([effect])
        beta = solve_bounded(small, small_right, np.concatenate([self.low, low]), np.concatenate([self.high, high]))
        return np.asarray(np.einsum("li,li->l", small_right, beta) - 0.5 * np.einsum("li,lij,lj->l", beta, small, beta))

    def _weighted(self, weights: Array) -> tuple[tuple[Array, bool], Array, Array, Array, Array]:
        """The ordinary errors' system under some weights, and the terms' part; the last one is kept."""
        key = weights.tobytes()
        if getattr(self, "_key", None) != key:
            board, k = self.board, len(self.low)
            system, right = np.eye(board.ordinary.size), np.zeros(board.ordinary.size)
            own, mixed, own_right = np.zeros((k, k)), np.zeros((k, board.ordinary.size)), np.zeros(k)
            for number, weight in enumerate(weights):
                at = board.ordinary.numbers[number]
                base = board.base[number].sum(axis=0)
                system[at[:, None], at] += weight * base[:-1, :-1]
                right[at] += weight * base[:-1, -1]
                if k:
                    ours = self.own_base[number].sum(axis=0)
                    own += weight * self.own_own[number].sum(axis=0)
                    mixed[:, at] += weight * ours[:, :-1]
                    own_right += weight * ours[:, -1]
            self._kept = (cho_factor(system), right, own, mixed, own_right)
            self._key = key
        return self._kept


def null_of(board: Board) -> Scored:
    """Ordinary errors alone; kept on the board."""
    if "null" not in board.kept:
        board.kept["null"] = Scorer(board).now
    found: Scored = board.kept["null"]
    return found


def place_columns(columns: Columns, number: int, place: Array) -> Array:
    """Columns of a block at a set of units, shape (m, P)."""
    x = columns.x[number]
    return np.asarray(np.einsum("mup,u->mp", x, place[columns.units[number]]), dtype=np.float64)


def _spread(place: Array, size: int) -> Array:
    """From columns of units (uP) to those of the place (P), shape (uP, P)."""
    return np.asarray(np.kron(place[:, None], np.eye(size)))


def _padded(values: Array, size: int, axis: int) -> Array:
    width = [(0, 0)] * values.ndim
    width[axis] = (0, size)
    return np.pad(values, width)


def _joined(base: Array, own: Array, both: Array) -> Array:
    """Products of [ordinary, coefficients, y], shape (F, q + k + 1, q + k + 1)."""
    n_folds, q, k = len(base), base.shape[1] - 1, own.shape[1]
    out = np.empty((n_folds, q + k + 1, q + k + 1))
    out[:, :q, :q] = base[:, :q, :q]
    out[:, :q, -1] = out[:, -1, :q] = base[:, :q, q]
    out[:, -1, -1] = base[:, q, q]
    if k:
        out[:, q:-1, :q] = own[:, :, :q]
        out[:, :q, q:-1] = np.swapaxes(own[:, :, :q], 1, 2)
        out[:, q:-1, -1] = out[:, -1, q:-1] = own[:, :, q]
        out[:, q:-1, q:-1] = both
    return out


__all__ = ["Ints", "Placed", "Scored", "Scorer", "bounds", "place_columns"]
