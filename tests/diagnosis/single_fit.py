"""Fit one effect, or several together, to the channels in which they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import lsq_linear, minimize

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints, Shape, Views
from diagnosis.library import Coefficient, LibraryEffect, legs_of

HUBER: Final = 2.5
"""Residuals beyond this many scales are held down."""
BLOCK_S: Final = 1.0
"""With few runs, errors come from blocks of about this length; with many, from whole runs."""
MANY_RUNS: Final = 5
POLISHED: Final = {"bus_sag": ("resistance_ohm", "back_emf_v_s_per_rad", "stall_nm_per_v", "copper_w_per_nm2")}
"""Numbers of a shape whose steps are too coarse to recover it."""
POLISH_EVALUATIONS: Final = 60
MIN_SAMPLES: Final = 10
REFINEMENTS: Final = 8
"""Rounds around the best shape, at most; they end when none is better."""


@dataclass(frozen=True)
class Term:
    """One effect at one place with one shape."""

    effect: LibraryEffect
    joints: Flags
    """Shape (J,)."""
    shape: Shape


@dataclass(frozen=True)
class Fit:
    """What came out for one or several terms."""

    terms: tuple[Term, ...]
    coefficients: tuple[Array, ...]
    """By term, shape (number of the effect's coefficients,)."""
    standard_errors: tuple[Array, ...]
    values: tuple[Mapping[str, float], ...]
    """Parameters of the spot_model effect, by term."""
    cost: float
    """Robust sum of squares in units of the noise, over all rows that any term touches."""
    cost_null: float
    """The same without any term."""
    cost_by_channel: Mapping[str, tuple[float, float]]
    """Null and fitted, by channel."""
    n_samples: int

    @property
    def explained(self) -> float:
        """Share of the null's cost that is gone, 0 to 1."""
        return 1.0 - self.cost / self.cost_null if self.cost_null > 0.0 else 0.0

    @property
    def z(self) -> float:
        """Largest coefficient over its standard error, of those that are free."""
        ratios = [
            abs(float(c)) / float(e)
            for cs, es in zip(self.coefficients, self.standard_errors, strict=True)
            for c, e in zip(cs, es, strict=True)
            if np.isfinite(e) and e > 0.0
        ]
        return max(ratios, default=float("nan"))


@dataclass(frozen=True)
class _Rows:
    """All scalar samples that the terms touch, m of them, scaled by their noise."""

    x: Array
    """Shape (m, P)."""
    y: Array
    fixed: Array
    """What columns without freedom add. Shape (m,)."""
    group: Ints
    """Run or block of each sample."""
    channel: Ints
    row: Ints
    """Number of the row over all channels."""
    is_robust: Flags
    """Whether outliers of the sample's channel are held down."""


def fit(effect: LibraryEffect, views: Views, joints: Flags) -> Fit:
    """Fit one effect at one place, with the best of its shapes, tried coarsely and then finer around the best.

    Args:
        effect: What to fit.
        views: The channels that are on.
        joints: Where, shape (J,).

    Raises:
        ValueError: The effect shows in none of the channels, or they have too few usable samples.
    """
    found: list[Fit] = []
    previous: Fit | None = None
    tried: set[tuple[tuple[str, float], ...]] = set()
    shapes = effect.shapes(views, joints)
    for _ in range(REFINEMENTS + 1):
        for shape in shapes:
            key = tuple(sorted(shape.items()))
            if key in tried:
                continue
            tried.add(key)
            found.append(fit_terms([Term(effect, joints, shape)], views))
        best = min(found, key=lambda f: f.cost)
        if best is previous:
            break
        found, previous = [best], best
        shapes = effect.refined(found[0].terms[0].shape)
    return _polished(found[0], views) if effect.name in POLISHED else found[0]


def _polished(start: Fit, views: Views) -> Fit:
    """A simplex search over the free numbers of the shape, from the best one of the rounds."""
    effect, joints, shape = start.terms[0].effect, start.terms[0].joints, start.terms[0].shape
    free, bounds = POLISHED[effect.name], {p.name: (p.low, p.high) for p in effect.effect.parameters()}
    found = [start]

    def cost(logs: Array) -> float:
        moved = {**shape, **{name: shape[name] * float(np.exp(log)) for name, log in zip(free, logs, strict=True)}}
        if not all(bounds[name][0] <= moved[name] <= bounds[name][1] for name in free):
            return 2.0 * start.cost_null
        found.append(fit_terms([Term(effect, joints, moved)], views))
        return found[-1].cost

    steps = np.concatenate([np.zeros((1, len(free))), 0.08 * np.eye(len(free))])
    options = {"maxfev": POLISH_EVALUATIONS, "xatol": 2e-3, "fatol": 1e-3 * start.cost, "initial_simplex": steps}
    minimize(cost, np.zeros(len(free)), method="Nelder-Mead", options=options)
    return min(found, key=lambda f: f.cost)


def fit_terms(terms: Sequence[Term], views: Views) -> Fit:
    """Fit several effects together at given shapes.

    Raises:
        ValueError: None of them shows in any channel, or there are too few usable samples.
    """
    coefficients = [c for term in terms for c in term.effect.coefficients]
    rows = _gather(terms, views)
    if rows is None or len(rows.y) < MIN_SAMPLES:
        names = ", ".join(term.effect.name for term in terms)
        raise ValueError(f"{names}: fewer than {MIN_SAMPLES} usable samples in channels {', '.join(views)}")
    null = _scaled_cost(rows.y)
    free = np.array([c.low < c.high for c in coefficients])
    target = rows.y - rows.fixed
    estimate = np.array([c.low if c.low == c.high else 0.0 for c in coefficients])
    weight = np.ones(len(target))
    scale = np.ones(len(target))
    x = rows.x[:, free]
    if free.any():
        for _ in range(4):
            estimate[free] = _bounded(x, target, weight / scale**2, [c for c in coefficients if c.low < c.high])
            residual = target - x @ estimate[free]
            scale = _scales(residual, rows)
            held = np.minimum(1.0, HUBER / np.maximum(np.abs(residual / scale), 1e-9))
            weight = np.where(rows.is_robust, held, 1.0)
    residual = target - x @ estimate[free]
    errors = np.full(len(coefficients), np.inf)
    errors[~free] = 0.0
    if free.any():
        errors[free] = _errors(x, residual, weight / scale**2, rows.group)
    cost = _scaled_cost(residual)
    parts: list[Array] = []
    part_errors: list[Array] = []
    at = 0
    for term in terms:
        size = len(term.effect.coefficients)
        parts.append(estimate[at : at + size])
        part_errors.append(errors[at : at + size])
        at += size
    channels = list(views)
    by_channel = {
        channels[c]: (_scaled_cost(rows.y, rows.channel == c), _scaled_cost(residual, rows.channel == c))
        for c in np.unique(rows.channel)
    }
    return Fit(
        terms=tuple(terms),
        coefficients=tuple(parts),
        standard_errors=tuple(part_errors),
        values=tuple(t.effect.values(c, t.shape) for t, c in zip(terms, parts, strict=True)),
        cost=cost,
        cost_null=null,
        cost_by_channel=by_channel,
        n_samples=len(target),
    )


def _gather(terms: Sequence[Term], views: Views) -> _Rows | None:
    free = np.array([c.low < c.high for term in terms for c in term.effect.coefficients])
    parts: list[tuple[Array, Array, Array, Ints, Ints, Ints, Flags]] = []
    n_rows = 0
    for number, (name, view) in enumerate(views.items()):
        blocks = [
            t.effect.columns(view, t.shape, t.joints)
            if name in t.effect.channels
            else np.zeros((view.n, len(view.rows), len(t.effect.coefficients)))
            for t in terms
        ]
        columns = np.concatenate(blocks, axis=2)
        values = np.array([c.low for t in terms for c in t.effect.coefficients])
        group = _groups(view)
        touched = np.zeros(len(view.rows), dtype=np.bool_)
        for t in terms:
            if name in t.effect.channels:
                touched |= _rows_of(t, view)
        for row in range(len(view.rows)):
            if not touched[row]:
                continue
            touching = columns[:, row, :]
            good = view.usable[:, row] & np.isfinite(touching).all(axis=1) & np.isfinite(view.response[:, row])
            if not good.any():
                continue
            y = view.response[good, row] / view.noise[row]
            x = touching[good] / view.noise[row]
            nuisance = view.nuisance[good, row]
            if nuisance.shape[1]:
                x, y = _without(nuisance, x), _without(nuisance, y[:, None])[:, 0]
            fixed = x[:, ~free] @ values[~free]
            m = len(y)
            parts.append((x, y, fixed, group[good], np.full(m, number), np.full(m, n_rows), np.full(m, view.is_robust)))
            n_rows += 1
    if not parts:
        return None
    x, y, fixed, group, channel, row_number, is_robust = (np.concatenate(p) for p in zip(*parts, strict=True))
    return _Rows(x, y, fixed, group, channel, row_number, is_robust)


def _rows_of(term: Term, view: ChannelView) -> Flags:
    """Rows of a channel that the term can touch, whatever its shape. Shape (R,)."""
    if view.name in term.effect.separable or view.name == Channel.SENSOR_NOISE:
        return np.asarray((view.row_joint >= 0) & term.joints[np.maximum(view.row_joint, 0)])
    legs = legs_of(term.joints, view)
    return np.asarray((view.row_leg < 0) | legs[np.maximum(view.row_leg, 0)])


def _without(nuisance: Array, values: Array) -> Array:
    """What of the columns ``values`` (m, P) the columns ``nuisance`` (m, q) do not explain."""
    scale = np.sqrt(np.mean(nuisance**2, axis=0)) + 1e-12
    q, _ = np.linalg.qr(nuisance / scale)
    return np.asarray(values - q @ (q.T @ values))


def _groups(view: ChannelView) -> Ints:
    """Samples that are not independent of each other: whole runs where there are many, else blocks."""
    n_runs = len(np.unique(view.run))
    if n_runs >= MANY_RUNS:
        return view.run
    block = view.state // max(1, round(BLOCK_S / 0.003))
    return np.asarray(view.run * 1_000_000 + block, dtype=np.intp)


def _scales(residual: Array, rows: _Rows) -> Array:
    """Robust scale of the residual of each row of each channel, at least 1 (its noise); per sample."""
    out = np.ones_like(residual)
    for row in np.unique(rows.row[rows.is_robust]):
        mine = rows.row == row
        out[mine] = max(1.0, 1.4826 * float(np.median(np.abs(residual[mine]))))
    return out


def _scaled_cost(residual: Array, chosen: Flags | None = None) -> float:
    """Robust sum of squares in units of the noise: square up to a bound, then straight."""
    values = np.abs(residual if chosen is None else residual[chosen])
    bound = 20.0
    return float(np.sum(np.where(values < bound, values**2, bound * (2.0 * values - bound))))


def _bounded(x: Array, y: Array, weight: Array, coefficients: Sequence[Coefficient]) -> Array:
    """Weighted least squares within the coefficients' bounds."""
    root = np.sqrt(weight)
    scale = np.sqrt(np.mean((x * root[:, None]) ** 2, axis=0)) + 1e-12
    gram = (x * weight[:, None] / scale).T @ (x / scale)
    right = (x / scale).T @ (weight * y)
    ridge = 1e-10 * np.trace(gram) / len(gram)
    factor = np.linalg.cholesky(gram + ridge * np.eye(len(gram))).T
    low = np.array([c.low for c in coefficients]) * scale
    high = np.array([c.high for c in coefficients]) * scale
    solution = np.linalg.solve(gram + ridge * np.eye(len(gram)), right)
    if np.any(solution < low) or np.any(solution > high):
        solution = lsq_linear(factor, np.linalg.solve(factor.T, right), bounds=(low, high), method="bvls").x
    return np.asarray(solution / scale)


def _errors(x: Array, residual: Array, weight: Array, group: Ints) -> Array:
    """Standard errors from sums over groups (sandwich), shape (P,)."""
    scale = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    x = x / scale
    bread = np.linalg.pinv((x * weight[:, None]).T @ x)
    _, number = np.unique(group, return_inverse=True)
    score = x * (weight * residual)[:, None]
    sums = np.stack([np.bincount(number, score[:, k]) for k in range(x.shape[1])], axis=1)
    n = len(sums)
    covariance = bread @ (sums.T @ sums) @ bread * n / max(n - 1, 1)
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale)
