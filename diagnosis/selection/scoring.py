"""One posterior over numbers: some of them free in their realistic range, all others within their ordinary errors.

A set of terms, each an effect of one shape at some units, has the value

    Σ −½ D log(m + t²)  −  ½ |γ|²  −  ½ |β/R|²  −  ½ log det(1 + R H R)  −  prices

over the blocks, with m the mean square of the residual in units of the noise, t the tolerance and D the number of
independent ways in which a formula that is not quite the truth can be off; γ the ordinary errors in published spreads,
β the terms' coefficients and R their realistic range; H the information about β that the ordinary errors leave. It is
the logarithm of a marginal likelihood, so values of any two sets compare. The price of a term is what its effect adds
on robots without a fault (:mod:`diagnosis.selection.faultless`), so that odds are even at 0. More data make m exact,
but do not make a formula truer, so D does not grow with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import gammaln

from diagnosis.channels import Array, Ints, Shape
from diagnosis.decision_constants import ERROR_SCALES, LARGEST_IN_SPREADS, ErrorScale
from diagnosis.library import LibraryEffect
from diagnosis.selection.evidence import Evidence, key_of
from diagnosis.selection.faultless import FAULTLESS
from diagnosis.selection.normal_equations import ColumnProducts, solve_bounded, solved

BELOW_NOISE: Final = 0.1
"""What a mean square counts below the least that counts: next to nothing, but the better of two fits stays better."""
ROUNDS: Final = 4
"""Rounds of weights and fit: weights follow the residuals."""


@dataclass(frozen=True)
class Placed:
    """One effect with a shape at a set of units."""

    effect: LibraryEffect
    shape: Shape
    place: Array
    """Shape (U,), 0 or 1."""


@dataclass(frozen=True)
class Scored:
    """A set of effects, fitted beside the ordinary errors."""

    terms: tuple[Placed, ...]
    coefficients: tuple[Array, ...]
    """By term."""
    pulls: Array
    """Ordinary errors in published spreads. Shape (Q,)."""
    weights: Array
    """What each block counts. Shape (B,)."""
    left: Array
    """Mean square of each block's residual, units of the noise. Shape (B,)."""
    explained: Array
    """Mean square that terms and ordinary errors take off each block. Shape (B,)."""
    value: float = 0.0
    """Logarithm of the marginal likelihood, against none of the effects."""
    by_block: Array = field(default_factory=lambda: np.zeros(0))
    """Each block's part of it. Shape (B,)."""
    spread: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Coefficients fitted without each fold, terms end to end, shape (F, K); filled by :func:`crossed`."""
    fold_pulls: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Ordinary errors fitted without each fold, shape (F, Q); likewise."""


def without_effect(board: Evidence, scored: Scored, name: str) -> Scored:
    """The fit less all that it has of one effect, as difference and as ordinary errors; all else stays as it is."""
    kept = [i for i, term in enumerate(scored.terms) if term.effect.name != name]
    owner = np.repeat([t.effect.name for t in scored.terms], [len(c) for c in scored.coefficients])
    mine = np.array(board.ordinary.names) == name
    return replace(
        scored,
        terms=tuple(scored.terms[i] for i in kept),
        coefficients=tuple(scored.coefficients[i] for i in kept),
        spread=scored.spread[:, owner != name],
        pulls=np.where(mine, 0.0, scored.pulls),
        fold_pulls=np.where(mine, 0.0, scored.fold_pulls),
    )


def bounds(effects: Sequence[LibraryEffect]) -> tuple[Array, Array]:
    """Bounds of all coefficients, end to end."""
    cs = [c for e in effects for c in e.coefficients]
    return np.array([c.low for c in cs], dtype=np.float64), np.array([c.high for c in cs], dtype=np.float64)


def realistic_range(effect: LibraryEffect) -> Array:
    """Largest realistic size of each coefficient, within its bounds; infinite without freedom. Shape (C,)."""
    given = ERROR_SCALES.get(effect.name, ErrorScale({}))
    times = LARGEST_IN_SPREADS * max(1.0, given.alike)
    asked = [effect.largest.get(c.name, times * given.scales.get(c.name, np.inf)) for c in effect.coefficients]
    within = np.minimum([max(abs(c.low), abs(c.high)) for c in effect.coefficients], asked)
    return np.where([c.is_free for c in effect.coefficients], within, np.inf)


def ranges(effects: Sequence[LibraryEffect]) -> Array:
    """Realistic range of all coefficients, end to end; infinite for those without freedom."""
    return np.concatenate([np.zeros(0), *(realistic_range(e) for e in effects)])


def by_term(terms: Sequence[Placed], beta: Array) -> tuple[Array, ...]:
    """Coefficients that stand end to end, by term."""
    return tuple(np.split(beta, np.cumsum([len(t.effect.coefficients) for t in terms]))[:-1])


def prices(board: Evidence, effect: LibraryEffect, places: Array) -> Array:
    """Nats at which the odds of an effect are even at each place, (L, U) to (L,).

    What is learned from faultless robots is the largest over all natural places and all shapes. A place that is no
    natural one counts each way in which as many units differ from the nearest.
    """
    natural = board.robot.places(effect)
    n_units = natural.shape[1]
    apart = np.abs(natural - places[:, None]).sum(axis=2).min(axis=1)
    ways = gammaln(n_units + 1) - gammaln(apart + 1) - gammaln(n_units - apart + 1)
    return np.asarray(FAULTLESS.price(effect.name) + ways)


class Products(NamedTuple):
    """Products of one block's columns of a candidate, uP of them: with [ordinary errors, y] and with themselves."""

    base: Array
    """Shape (uP, q + 1)."""
    own: Array
    """Shape (uP, uP)."""
    units: Ints
    """Which the candidate's columns are of. Shape (u,)."""


class Scorer:
    """Values of candidates on a board, beside terms that are already in."""

    def __init__(self, board: Evidence, terms: Sequence[Placed] = ()) -> None:
        """Choose what is already in."""
        self.board = board
        self.terms = tuple(terms)
        self.low, self.high = bounds([t.effect for t in terms])
        self.own = term_columns(board, terms)
        self._own_cross: dict[tuple[object, ...], list[Array]] = {}
        self._tried = products_of_terms(board, self.own)
        self.now = fitted_terms(board, self.terms, self._tried)
        self.weights = self.now.weights
        self._by_weights: tuple[bytes, tuple[Any, ...]] = (b"", ())

    def scored(self, effect: LibraryEffect, shape: Shape, place: Array) -> Scored:
        """The terms and one candidate, fitted."""
        return Scorer(self.board, (*self.terms, Placed(effect, shape, place))).now

    def residuals(self) -> list[Array]:
        """What the terms and the ordinary errors leave in each block."""
        ordinary, beta = self.board.ordinary, np.concatenate([np.zeros(0), *self.now.coefficients])
        return [
            b.y - x @ beta - z @ self.now.pulls[numbers]
            for b, x, z, numbers in zip(self.board.blocks, self.own, ordinary.x, ordinary.numbers, strict=True)
        ]

    def crosses(self, effect: LibraryEffect, shape: Shape) -> list[Products | None]:
        """By block the products of a candidate's columns; kept on the board."""
        key = ("cross", *key_of(effect, shape))
        if key not in self.board.kept:
            made = self.board.columns(effect, shape)
            self.board.kept[key] = [
                Products(self.board.products(n, x), self.board.products_of(n, x, x), units) if x.shape[1] else None
                for n, (x, units) in enumerate(zip(made.flat(), made.units, strict=True))
            ]
        kept: list[Products | None] = self.board.kept[key]
        return kept

    def _crosses_with_own(self, effect: LibraryEffect, shape: Shape) -> list[Array]:
        """By block the products of the terms' columns and the candidate's, shape (K, uP).

        Those of each term are kept on the board: columns, which take longest, are made once for each new term.
        """
        key = key_of(effect, shape)
        if key not in self._own_cross:
            ends = np.cumsum([0 if part is None else len(part.base) for part in self.crosses(effect, shape)])[:-1]
            by_term = np.concatenate([self._cross_with(i, effect, shape) for i in range(len(self.terms))])
            self._own_cross[key] = np.split(by_term, ends, axis=1)
        return self._own_cross[key]

    def _cross_with(self, i: int, effect: LibraryEffect, shape: Shape) -> Array:
        """The products of one term's columns and the candidate's, of all blocks end to end; shape (P, ΣuP)."""
        term, board = self.terms[i], self.board
        key = ("with", *key_of(term.effect, term.shape), term.place.tobytes(), *key_of(effect, shape))
        if key not in board.kept:
            first = sum(len(t.effect.coefficients) for t in self.terms[:i])
            mine = slice(first, first + len(term.effect.coefficients))
            x = board.columns(effect, shape).flat()
            parts = [board.products_of(n, self.own[n][:, mine], x[n]) for n in range(len(x))]
            board.kept[key] = np.concatenate(parts, axis=1)
        found: Array = board.kept[key]
        return found

    def information(self, effect: LibraryEffect, shape: Shape, weights: Array) -> tuple[Array, Array]:
        """What is known of the terms' coefficients and the candidate's at each of its units, beside ordinary errors.

        Returns:
            XᵀWX − XᵀWZ(ZᵀWZ + 1)⁻¹ZᵀWX, and the same of X and y; shape (K + UP,) twice and once.
        """
        board, size, k = self.board, len(effect.coefficients), len(self.low)
        cross, with_own = self.crosses(effect, shape), self._crosses_with_own(effect, shape) if k else []
        width = k + len(board.robot.units(effect.location)) * size
        gram, mixed, right = np.zeros((width, width)), np.zeros((width, board.ordinary.size)), np.zeros(width)
        factor, right_ordinary, own_gram, own_mixed, own_right = self._weighted(weights)
        gram[:k, :k], mixed[:k], right[:k] = own_gram, own_mixed, own_right
        for number, part in enumerate(cross):
            if part is None:
                continue
            at = board.ordinary.numbers[number]
            columns_at = k + (part.units[:, None] * size + np.arange(size)).ravel()
            base = weights[number] * part.base
            right[columns_at] += base[:, -1]
            mixed[columns_at[:, None], at] += base[:, :-1]
            gram[columns_at[:, None], columns_at] += weights[number] * part.own
            if k:
                both = weights[number] * with_own[number]
                gram[np.arange(k)[:, None], columns_at] += both
                gram[columns_at[:, None], np.arange(k)] += both.T
        solved_for = cho_solve(factor, np.concatenate([mixed.T, right_ordinary[:, None]], axis=1))
        return gram - mixed @ solved_for[:, :-1], right - mixed @ solved_for[:, -1]

    def gains(self, effect: LibraryEffect, shape: Shape, places: Array, weights: Array) -> Array:
        """What the candidate adds at each place (L, U) beside the terms, under given weights; shape (L,).

        Without what the choice among places costs.
        """
        gram, right = self.information(effect, shape, weights)
        size, k = len(effect.coefficients), len(self.low)
        spread = np.zeros((len(places), len(right), k + size))
        spread[:, :k, :k] = np.eye(k)
        for p in range(size):
            spread[:, k + p :: size, k + p] = places
        turned = np.swapaxes(spread, 1, 2)
        small, small_right = turned @ gram @ spread, np.asarray(turned @ right)
        low, high = bounds([effect])
        wide = ranges([*(t.effect for t in self.terms), effect])
        held = small + np.diag(wide**-2)
        beta = solve_bounded(held, small_right, np.concatenate([self.low, low]), np.concatenate([self.high, high]))
        fit = np.einsum("li,li->l", small_right, beta) - 0.5 * np.einsum("li,lij,lj->l", beta, held, beta)
        return np.asarray(fit - _occam(small, wide))

    def _weighted(self, weights: Array) -> tuple[Any, ...]:
        """The ordinary errors' system under some weights, and the terms' part; the last one is kept."""
        key = weights.tobytes()
        if self._by_weights[0] != key:
            sums, tried = self.board.sums, self._tried
            found = (
                sums.system(sums.total, weights),
                weights @ sums.total.with_y,
                np.tensordot(weights, tried.own, 1),
                sums.mixed(tried.by_row, weights).T,
                weights @ tried.with_y,
            )
            self._by_weights = key, found
        return self._by_weights[1]


def _occam(information: Array, wide: Array) -> Array:
    """½ log det(1 + R H R) over the coefficients that have freedom; (..., k, k) to (...)."""
    free = np.isfinite(wide)
    r = wide[free]
    inside = np.eye(len(r)) + r[:, None] * information[..., free, :][..., :, free] * r
    return np.asarray(0.5 * np.linalg.slogdet(inside)[1])


def fitted_terms(board: Evidence, terms: tuple[Placed, ...], tried: ColumnProducts) -> Scored:
    """Terms and ordinary errors, fitted under weights that stand still, and their value."""
    sums, effects = board.sums, [t.effect for t in terms]
    (low, high), wide = bounds(effects), ranges(effects)
    weights = board.dof / (sums.total.yy + board.tolerance_square)
    for _ in range(ROUNDS):
        pulls, beta, information = solved(sums, sums.total, tried, weights, low, high, held=wide**-2)
        left = sums.left(sums.total, tried, pulls, beta)
        # Ordinary errors too are formulas: what they explain is as uncertain as what an effect explains.
        explained = np.maximum(sums.total.yy - left, 0.0)
        counted = np.maximum(left, board.least + BELOW_NOISE * (left - board.least))
        may = counted + board.tolerance_square + board.relative_square * explained
        weights = board.dof / may
    by_block = -0.5 * board.dof * np.log(may)
    size = 0.5 * float(pulls @ pulls) + 0.5 * float(np.sum((beta / wide) ** 2))
    paid = sum(float(prices(board, t.effect, t.place[None])[0]) for t in terms)
    value = float(by_block.sum()) - size - float(_occam(information, wide)) - paid
    if terms:
        null = null_of(board)
        value, by_block = value - null.value, by_block - null.by_block
    return Scored(terms, by_term(terms, beta), pulls, weights, left, explained, value, by_block)


def crossed(board: Evidence, scored: Scored) -> Scored:
    """The same fit with what it is without each fold, under its weights."""
    columns = term_columns(board, scored.terms)
    tried, by_fold = (
        products_of_terms(board, columns),
        [products_of_terms(board, columns, f) for f in range(board.n_folds)],
    )
    sums, effects = board.sums, [t.effect for t in scored.terms]
    (low, high), wide = bounds(effects), ranges(effects)
    found = [
        solved(sums, sums.total - own, tried - mine, scored.weights, low, high, held=wide**-2)
        for own, mine in zip(sums.folds, by_fold, strict=True)
    ]
    return replace(
        scored, fold_pulls=np.array([pulls for pulls, _, _ in found]), spread=np.array([beta for _, beta, _ in found])
    )


def products_of_terms(board: Evidence, columns: Sequence[Array], fold: int | None = None) -> ColumnProducts:
    """Products of the terms' columns, by block, over all folds or in one."""
    base = [board.products(n, x, fold) for n, x in enumerate(columns)]
    return ColumnProducts.of(base, [board.products_of(n, x, x, fold) for n, x in enumerate(columns)])


def posterior_covariance(board: Evidence, scored: Scored) -> Array:
    """Covariance of what was fitted: ordinary errors in published spreads, then the terms' coefficients.

    Shape (Q + K, Q + K), in the units of ``scored.pulls`` and ``scored.coefficients``, terms end to end; a coefficient
    at one of its bounds counts as known.
    """
    sums, weights = board.sums, scored.weights
    q = sums.size
    own = cho_solve(sums.system(sums.total, weights), np.eye(q), check_finite=False)
    if not scored.terms:
        return np.asarray(own)
    effects = [t.effect for t in scored.terms]
    tried = products_of_terms(board, term_columns(board, scored.terms))
    beta = np.concatenate(scored.coefficients)
    low, high = bounds(effects)
    free = np.flatnonzero((beta > low) & (beta < high))
    mixed = sums.mixed(tried.by_row, weights)[:, free]
    moved = own @ mixed
    reduced = np.tensordot(weights, tried.own, 1)[np.ix_(free, free)] - mixed.T @ moved
    inner = np.linalg.pinv(reduced + np.diag(ranges(effects)[free] ** -2), hermitian=True)
    out = np.zeros((q + len(beta), q + len(beta)))
    out[:q, :q] = own + moved @ inner @ moved.T
    out[:q, q + free] = -moved @ inner
    out[q + free, :q] = out[:q, q + free].T
    out[np.ix_(q + free, q + free)] = inner
    return out


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


def likeness(scorer: Scorer, names: Sequence[str]) -> Array:
    """By pair of effects of the scorer's terms, the share of what the first explains that the second could explain.

    Both beside the ordinary errors: with G the information about the terms' coefficients β, it is
    |P_j x_i β_i|² / |x_i β_i|² in the metric of G.

    Returns:
        Shape (T, T), 1 on the diagonal.
    """
    factor, _, gram, mixed, _ = scorer._weighted(scorer.weights)
    gram, beta = gram - mixed @ cho_solve(factor, mixed.T), np.concatenate(scorer.now.coefficients)
    owner = np.repeat([t.effect.name for t in scorer.terms], [len(c) for c in scorer.now.coefficients])
    parts = [np.flatnonzero(owner == name) for name in names]
    out = np.eye(len(parts))
    for i, mine in enumerate(parts):
        energy = float(beta[mine] @ gram[np.ix_(mine, mine)] @ beta[mine])
        for j, other in enumerate(parts):
            if i != j and energy > 0.0:
                along = gram[np.ix_(other, mine)] @ beta[mine]
                out[i, j] = float(along @ np.linalg.pinv(gram[np.ix_(other, other)], hermitian=True) @ along) / energy
    return np.clip(out, 0.0, 1.0)
