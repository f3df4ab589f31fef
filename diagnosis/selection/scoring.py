"""Fit several effects at given places and shapes beside the ordinary errors, and score them on folds never seen.

A model's value is −½ Σ D log(m + t²) − ½ |γ|²: over the blocks, with m the mean square of the residual in folds that
the fit never saw (units of the noise), t the tolerance, D the number of independent ways in which a formula that is not
quite the truth can be off; and γ the ordinary errors in units of their usual sizes. More data make m exact, but do not
make a formula truer, so D does not grow with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from diagnosis.channels import Array, Shape
from diagnosis.library import LibraryEffect
from diagnosis.selection.evidence import Evidence, key_of
from diagnosis.selection.normal_equations import ColumnProducts, OrdinarySums, products_by_fold, solve_bounded, solved

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
    """Value of each block, without what the ordinary errors cost. Shape (B,)."""
    held_out: Array
    """Mean square of each block's residual in folds that the fit never saw, units of the noise. Shape (B,)."""
    pulls: Array
    """Ordinary errors in units of their usual sizes. Shape (Q,)."""
    fold_pulls: Array
    """Ordinary errors in these units, fitted without each fold. Shape (F, Q)."""
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


def without_effect(board: Evidence, scored: Scored, name: str) -> Scored:
    """The fit less one effect, and less what its joint types or legs have of it by ordinary errors.

    All other ordinary errors stay as they are beside it, so that models with it and without it differ by it alone.
    """
    for which in reversed([i for i, term in enumerate(scored.terms) if term.effect.name == name]):
        scored = without(scored, which)
    shared = np.zeros(len(scored.pulls), dtype=np.bool_)
    for kind in board.ordinary.kinds:
        if kind.effect.name == name:
            for k in range(len(kind.chosen)):
                shared[kind.columns(k)] = kind.alike
    return replace(
        scored, pulls=np.where(shared, 0.0, scored.pulls), fold_pulls=np.where(shared, 0.0, scored.fold_pulls)
    )


def bounds(effects: Sequence[LibraryEffect]) -> tuple[Array, Array]:
    """Bounds of all coefficients, end to end."""
    cs = [c for e in effects for c in e.coefficients]
    return np.array([c.low for c in cs], dtype=np.float64), np.array([c.high for c in cs], dtype=np.float64)


class Crosses(NamedTuple):
    """Products of one block's columns of a candidate, uP of them: with [ordinary errors, y] and with themselves."""

    base: Array
    """By fold, shape (F, uP, q + 1)."""
    own: Array
    """By fold, shape (F, uP, uP)."""
    whole_base: Array
    """Over all folds."""
    whole_own: Array


class Scorer:
    """Scores candidates on a board, beside terms that are already in."""

    def __init__(self, board: Evidence, terms: Sequence[Placed] = ()) -> None:
        """Choose what is already in."""
        self.board = board
        self.terms = tuple(terms)
        self.low, self.high = bounds([t.effect for t in terms])
        self.own = term_columns(board, terms)
        self._is_touched = [bool(x.any()) for x in self.own]
        """By block, whether any term shows there."""
        self.own_base = [board.products(n, x) for n, x in enumerate(self.own)]
        self.own_own = [board.products_of(n, x, x) for n, x in enumerate(self.own)]
        self._own_cross: dict[tuple[object, ...], list[tuple[Array, Array]]] = {}
        self._tried, by_fold = products_by_fold(self.own_base, self.own_own)
        self.now, self.weights = _fitted(board, self.terms, self._tried, by_fold)
        self._by_weights: tuple[bytes, tuple[Any, ...]] = (b"", ())

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
                mixed = own[number][0] @ spread
                square[:, :k, k:], square[:, k:, :k] = mixed, np.swapaxes(mixed, 1, 2)
                square[:, k:, k:] = spread.T @ part.own @ spread
            base.append(ours)
            both.append(square)
        return _fitted(self.board, (*self.terms, Placed(effect, shape, place)), *products_by_fold(base, both))

    def residuals(self, cap: float = np.inf) -> list[Array]:
        """What the terms and the ordinary errors leave in each block, those held to so many usual sizes."""
        pulls = np.clip(self.now.pulls, -cap, cap)
        ordinary = self.board.ordinary
        beta = np.concatenate([np.zeros(0), *self.now.coefficients])
        return [
            b.y - x @ beta - z @ pulls[numbers]
            for b, x, z, numbers in zip(self.board.blocks, self.own, ordinary.x, ordinary.numbers, strict=True)
        ]

    def crosses(self, effect: LibraryEffect, shape: Shape) -> list[Crosses | None]:
        """By block the products of a candidate's columns; kept on the board."""
        key = ("cross", *key_of(effect, shape))
        if key not in self.board.kept:
            found: list[Crosses | None] = []
            for number, flat in enumerate(self.board.columns(effect, shape).flat()):
                base, own = self.board.products(number, flat), self.board.products_of(number, flat, flat)
                found.append(Crosses(base, own, base.sum(axis=0), own.sum(axis=0)) if flat.shape[1] else None)
            self.board.kept[key] = found
        kept: list[Crosses | None] = self.board.kept[key]
        return kept

    def _crosses_with_own(self, effect: LibraryEffect, shape: Shape) -> list[tuple[Array, Array]]:
        """By block the products of the terms' columns and the candidate's: by fold (F, K, uP), and over all folds."""
        key = key_of(effect, shape)
        if key not in self._own_cross:
            found = []
            for number, flat in enumerate(self.board.columns(effect, shape).flat()):
                product = np.zeros((self.board.n_folds, len(self.low), flat.shape[1]))
                if self._is_touched[number]:
                    product = self.board.products_of(number, self.own[number], flat)
                found.append((product, product.sum(axis=0)))
            self._own_cross[key] = found
        return self._own_cross[key]

    def gains(self, effect: LibraryEffect, shape: Shape, places: Array, weights: Array) -> Array:
        """What the candidate takes off the weighted squares at each place (L, U) beside the terms; shape (L,), nats."""
        board, columns = self.board, self.board.columns(effect, shape)
        cross, with_own = self.crosses(effect, shape), self._crosses_with_own(effect, shape)
        size, k = len(effect.coefficients), len(self.low)
        width = k + places.shape[1] * size
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
                both = weights[number] * with_own[number][1]
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

    def _weighted(self, weights: Array) -> tuple[Any, ...]:
        """The ordinary errors' system under some weights, and the terms' part; the last one is kept."""
        key = weights.tobytes()
        if self._by_weights[0] != key:
            sums, tried = sums_of(self.board), self._tried
            found = (
                sums.system(sums.total, weights),
                weights @ sums.total.with_y,
                np.tensordot(weights, tried.own, 1),
                sums.mixed(tried.by_row, weights).T,
                weights @ tried.with_y,
            )
            self._by_weights = key, found
        return self._by_weights[1]


def _fitted(
    board: Evidence, terms: tuple[Placed, ...], tried: ColumnProducts, by_fold: list[ColumnProducts]
) -> tuple[Scored, Array]:
    """Terms and ordinary errors, fitted and scored, and the blocks' weights that belong to them."""
    sums, (low, high) = sums_of(board), bounds([t.effect for t in terms])
    weights = board.dof / (sums.total.yy + board.tolerance_square)
    for _ in range(ROUNDS):
        pulls, beta = solved(sums, sums.total, tried, weights, low, high)
        # Ordinary errors too are formulas: what they explain is as uncertain as what an effect explains.
        weights = weights_of(board, *sums.squares(sums.total, tried, pulls, beta))
    found = fitted_under(board, terms, tried, by_fold, weights)
    tolerance = board.tolerance_square + board.relative_square * found.explained
    by_block = -0.5 * board.dof * np.log(found.held_out + tolerance)
    cost = 0.5 * float(found.pulls @ found.pulls)
    if terms:
        null = null_of(board)
        by_block = by_block - null.by_block
        cost -= 0.5 * float(null.pulls @ null.pulls)
    return replace(found, score=float(by_block.sum()) - cost, by_block=by_block), weights


def weights_of(board: Evidence, left: Array, explained: Array) -> Array:
    """What a block counts, from the mean squares that are left and explained in it; each shape (B,)."""
    return np.asarray(board.dof / (left + board.tolerance_square + board.relative_square * explained))


def fitted_under(
    board: Evidence,
    terms: tuple[Placed, ...],
    tried: ColumnProducts,
    by_fold: Sequence[ColumnProducts],
    weights: Array,
    precision: Array | float = 1.0,
) -> Scored:
    """Terms and ordinary errors under given weights, fitted to all folds and without each; not scored.

    ``tried`` and ``by_fold`` are products of their columns, ``precision`` that of the ordinary errors' priors (Q,).
    """
    sums, (low, high) = sums_of(board), bounds([t.effect for t in terms])
    pulls, beta = solved(sums, sums.total, tried, weights, low, high, precision)
    held_out = np.zeros(len(board.blocks))
    spread, fold_pulls = np.zeros((board.n_folds, len(low))), np.zeros((board.n_folds, sums.size))
    for fold, own in enumerate(by_fold):
        fold_pulls[fold], spread[fold] = solved(sums, sums.others[fold], tried - own, weights, low, high, precision)
        held_out += sums.squares(sums.folds[fold], own, fold_pulls[fold], spread[fold])[0]
    explained = sums.squares(sums.total, tried, pulls, beta)[1]
    return Scored(terms, by_term(terms, beta), spread, 0.0, np.zeros(0), held_out, pulls, fold_pulls, explained)


def by_term(terms: Sequence[Placed], beta: Array) -> tuple[Array, ...]:
    """Coefficients that stand end to end, by term."""
    return tuple(np.split(beta, np.cumsum([len(t.effect.coefficients) for t in terms]))[:-1])


def sums_of(board: Evidence) -> OrdinarySums:
    """What is the same whatever is tried; kept on the board."""
    if "sums" not in board.kept:
        board.kept["sums"] = OrdinarySums(board.ordinary.numbers, board.ordinary.size, board.base)
    found: OrdinarySums = board.kept["sums"]
    return found


def null_of(board: Evidence) -> Scored:
    """Ordinary errors alone; kept on the board."""
    if "null" not in board.kept:
        board.kept["null"] = Scorer(board).now
    found: Scored = board.kept["null"]
    return found


def term_columns(board: Evidence, terms: Sequence[Placed]) -> list[Array]:
    """By block the columns of all terms, end to end; shape (m, K)."""
    parts = [[np.zeros((len(block.y), 0))] for block in board.blocks]
    for term in terms:
        columns = board.columns(term.effect, term.shape)
        for part, units, x in zip(parts, columns.units, columns.x, strict=True):
            part.append(np.einsum("mup,u->mp", x, term.place[units]).astype(np.float64))
    return [np.concatenate(part, axis=1) for part in parts]


def _spread(place: Array, size: int) -> Array:
    """From columns of units (uP) to those of the place (P), shape (uP, P)."""
    return np.asarray((place[:, None, None] * np.eye(size)).reshape(-1, size))


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
