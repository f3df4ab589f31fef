"""Fit several effects at given places and shapes beside the ordinary errors, and score them on folds never seen.

A model's value is −½ Σ D log(m + t²) − ½ |γ|²: over the blocks, with m the mean square of the residual in folds that
the fit never saw (units of the noise), t the tolerance, D the number of independent ways in which a formula that is not
quite the truth can be off; and γ the ordinary errors in units of their usual sizes. More data make m exact, but do not
make a formula truer, so D does not grow with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.linalg import cho_solve

from diagnosis.channels.channel_view import Array, Ints, Shape
from diagnosis.library.base import LibraryEffect
from diagnosis.selection.evidence import Board, Columns
from diagnosis.selection.normal_equations import OrdinarySums, solve_bounded, solved, tried_by_fold

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
    fold_pulls: Array
    """The same, fitted without each fold. Shape (F, Q)."""
    explained: Array
    """Mean square of what terms and ordinary errors explain in each block, units of the noise. Shape (B,)."""


def without(scored: Scored, which: int) -> Scored:
    """The same fit with one effect taken out, its ordinary errors as they are beside the effect; scores stay."""
    sizes = [len(c) for c in scored.coefficients]
    at = sum(sizes[:which])
    return replace(
        scored,
        terms=scored.terms[:which] + scored.terms[which + 1 :],
        coefficients=scored.coefficients[:which] + scored.coefficients[which + 1 :],
        spread=np.delete(scored.spread, slice(at, at + sizes[which]), axis=1),
    )


@dataclass(frozen=True)
class _Fitted:
    beta: Array
    pulls: Array
    fold_pulls: Array
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
    whole_base: Array
    """Over all folds."""
    whole_own: Array

    @staticmethod
    def of(base: Array, own: Array) -> _Cross:
        """With the sums over the folds."""
        return _Cross(base, own, base.sum(axis=0), own.sum(axis=0))


@dataclass(frozen=True)
class _WithOwn:
    """Products of one block's columns of the terms and of a candidate."""

    by_fold: Array
    """Shape (F, K, uP)."""
    whole: Array


class Scorer:
    """Scores candidates on a board, beside terms that are already in."""

    def __init__(self, board: Board, terms: Sequence[Placed] = ()) -> None:
        """Choose what is already in."""
        self.board = board
        self.terms = tuple(terms)
        self.low, self.high = bounds([t.effect for t in terms])
        self.own = term_columns(board, terms)
        self._is_touched = [bool(x.any()) for x in self.own]
        """By block, whether any term shows there."""
        self.own_base = [board.products(n, x) for n, x in enumerate(self.own)]
        self.own_own = [board.products_of(n, x, x) for n, x in enumerate(self.own)]
        self._own_cross: dict[tuple[object, ...], list[_WithOwn]] = {}
        self._tried, _ = tried_by_fold(self.own_base, self.own_own)
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
        size, k = len(effect.coefficients), len(self.low)
        base, both = [], []
        for number in range(len(self.board.blocks)):
            units, part = columns.units[number], cross[number]
            n_folds, _, width = self.own_base[number].shape
            ours, square = np.zeros((n_folds, k + size, width)), np.zeros((n_folds, k + size, k + size))
            ours[:, :k], square[:, :k, :k] = self.own_base[number], self.own_own[number]
            if part is not None:
                spread = _spread(place[units], size)
                ours[:, k:] = spread.T @ part.base
                mixed = own[number].by_fold @ spread
                square[:, :k, k:], square[:, k:, :k] = mixed, np.swapaxes(mixed, 1, 2)
                square[:, k:, k:] = spread.T @ part.own @ spread
            base.append(ours)
            both.append(square)
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
        sums = sums_of(board)
        tried, by_fold = tried_by_fold(base, both)
        weights = board.dof / (sums.total.yy + board.tolerance_square)
        for _ in range(ROUNDS):
            pulls, beta = solved(sums, sums.total, tried, weights, low, high)
            left, explained = sums.squares(sums.total, tried, pulls, beta)
            # Ordinary errors too are formulas: what they explain is as uncertain as what an effect explains.
            weights = board.dof / (left + board.tolerance_square + board.relative_square * explained)
        pulls, beta = solved(sums, sums.total, tried, weights, low, high)
        _, explained = sums.squares(sums.total, tried, pulls, beta)
        held_out = np.zeros(len(board.blocks))
        spread = np.zeros((board.n_folds, len(low)))
        fold_pulls = np.zeros((board.n_folds, sums.size))
        for fold, own in enumerate(by_fold):
            fold_pulls[fold], spread[fold] = solved(sums, sums.others[fold], tried - own, weights, low, high)
            held_out += sums.squares(sums.folds[fold], own, fold_pulls[fold], spread[fold])[0]
        return _Fitted(beta, pulls, fold_pulls, spread, held_out, explained, weights)

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
            terms,
            tuple(parts),
            fitted.spread,
            score,
            by_block,
            fitted.held_out,
            fitted.pulls,
            fitted.fold_pulls,
            fitted.explained,
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
                    _Cross.of(self.board.products(number, flat), self.board.products_of(number, flat, flat))
                    if flat.shape[1]
                    else None
                )
            self.board.kept[key] = found
        kept: list[_Cross | None] = self.board.kept[key]
        return kept

    def _crosses_with_own(self, effect: LibraryEffect, shape: Shape) -> list[_WithOwn]:
        """By block the products of the terms' columns and the candidate's."""
        key = (effect.name, *sorted(shape.items()))
        if key not in self._own_cross:
            columns = self.board.columns(effect, shape)
            found = [self._with_own(number, x.reshape(len(x), -1)) for number, x in enumerate(columns.x)]
            self._own_cross[key] = [_WithOwn(x, x.sum(axis=0)) for x in found]
        return self._own_cross[key]

    def _with_own(self, number: int, x: Array) -> Array:
        if not self._is_touched[number]:
            return np.zeros((self.board.n_folds, len(self.low), x.shape[1]))
        return self.board.products_of(number, self.own[number], x)

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
            base = weights[number] * part.whole_base
            right[columns_at] += base[:, -1]
            mixed[columns_at[:, None], at] += base[:, :-1]
            gram[columns_at[:, None], columns_at] += weights[number] * part.whole_own
            if k:
                both = weights[number] * with_own[number].whole
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
            sums, tried = sums_of(self.board), self._tried
            self._kept = (
                sums.system(sums.total, weights),
                weights @ sums.total.with_y,
                np.tensordot(weights, tried.own, 1),
                sums.mixed(tried.by_row, weights).T,
                weights @ tried.with_y,
            )
            self._key = key
        return self._kept


def sums_of(board: Board) -> OrdinarySums:
    """What is the same whatever is tried; kept on the board."""
    if "sums" not in board.kept:
        board.kept["sums"] = OrdinarySums(board.ordinary.numbers, board.ordinary.size, board.base)
    found: OrdinarySums = board.kept["sums"]
    return found


def null_of(board: Board) -> Scored:
    """Ordinary errors alone; kept on the board."""
    if "null" not in board.kept:
        board.kept["null"] = Scorer(board).now
    found: Scored = board.kept["null"]
    return found


def term_columns(board: Board, terms: Sequence[Placed]) -> list[Array]:
    """By block the columns of all terms, end to end; shape (m, K)."""
    return [
        np.concatenate(
            [np.zeros((len(b.y), 0)), *(place_columns(board.columns(t.effect, t.shape), n, t.place) for t in terms)],
            axis=1,
        )
        for n, b in enumerate(board.blocks)
    ]


def place_columns(columns: Columns, number: int, place: Array) -> Array:
    """Columns of a block at a set of units, shape (m, P)."""
    x = columns.x[number]
    return np.asarray(np.einsum("mup,u->mp", x, place[columns.units[number]]), dtype=np.float64)


def _spread(place: Array, size: int) -> Array:
    """From columns of units (uP) to those of the place (P), shape (uP, P)."""
    return np.asarray((place[:, None, None] * np.eye(size)).reshape(-1, size))


__all__ = ["Ints", "Placed", "Scored", "Scorer", "bounds", "place_columns"]
