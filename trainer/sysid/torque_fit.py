"""Parameters from measured torque: robust least squares on predicted against measured load, with honest intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.optimize
import scipy.stats
from numpy.typing import NDArray

from spot_model import facts
from trainer.sysid.space import SearchSpace
from trainer.sysid.torque_model import MIN_SPEED_RAD_S, NUISANCE_NAMES, NUISANCE_SCALE, TorqueModel
from trainer.sysid.torque_samples import TorqueSamples

Array = NDArray[np.float64]

LARGE_REQUEST_NM: Final = 20.0
"""Requests from here on are kept at any speed: friction is small beside them."""
N_ROUGH: Final = 2_500
N_FINE: Final = 30_000
"""Rows of the rough fit from several starts, and of the final one."""
LIMIT_SHARE: Final = 0.35
"""Share of the rows that are the largest driving requests, the rest evenly drawn."""
STOP_MARGIN_RAD: Final = 0.05
"""Nearer than this to a joint stop, the stop's own torque is in the load."""
ACTIVE_NM: Final = 0.3
"""A sample bears on a parameter if the parameter's whole width of bounds, at the local slope, moves it by this."""


@dataclass(frozen=True)
class TorqueFit:
    """What the torque samples say about each parameter of the search space."""

    values: Array
    """Shape (n,); the starting value where the samples say nothing."""
    covered: NDArray[np.bool_]
    """Parameters that this fit moved, shape (n,)."""
    standard_error: Array
    """Shape (n,); infinite where the samples say nothing."""
    alone_error: Array
    """Standard error if all other parameters were known, shape (n,)."""
    correlation: Array
    """Between the parameters' estimates, shape (n, n)."""
    active_samples: NDArray[np.intp]
    """Samples that bear on each parameter, shape (n,)."""
    active_runs: NDArray[np.intp]
    degrees_of_freedom: Array
    """For Student's t, shape (n,)."""
    nuisance: Array
    residual_nm: float
    """Robust scale of what remains."""

    def half_width(self, confidence: float) -> Array:
        """Half the width of the central interval, shape (n,)."""
        return np.asarray(self.standard_error * scipy.stats.t.ppf(0.5 + confidence / 2.0, self.degrees_of_freedom))


def fit_torque(
    model: TorqueModel, samples: TorqueSamples, starts: Sequence[Array], rng: np.random.Generator
) -> TorqueFit:
    """Fit by soft-L1 least squares; the best of several starts.

    Standard errors come from how far whole runs pull the answer apart, and legs beside them (sandwich estimates):
    samples within a run are not independent, and legs that disagree are a sign of what the model lacks.

    Args:
        model: Predicts load.
        samples: All samples.
        starts: Values to start from, each of shape (n,).
        rng: Draws the rows.
    """
    covered = model.covered()
    space = model.space
    low, high = np.zeros(space.n), np.ones(space.n)
    keep = usable(samples)
    rough, fine = (_selection(samples, keep, n, rng) for n in (N_ROUGH, N_FINE))

    def unpack(x: Array, base: Array) -> tuple[Array, Array]:
        unit = base.copy()
        unit[covered] = x[: covered.sum()]
        return space.values_of_unit(unit), x[covered.sum() :] * NUISANCE_SCALE

    def solve(rows: NDArray[np.intp], x: Array, base: Array, scale: float) -> tuple[Array, float]:
        part, used = samples.rows(rows), keep[rows]

        def residual(x: Array) -> Array:
            values, nuisance = unpack(x, base)
            return np.asarray(((part.load_nm - model.load_nm(part, values, nuisance)) / doubt)[used])

        doubt = _relative_doubt(model, part, *unpack(x, base), scale)
        free = np.full(len(NUISANCE_NAMES), np.inf)
        bounds = (np.concatenate([low[covered], -free]), np.concatenate([high[covered], free]))
        inside = np.clip(x, bounds[0] + 1e-6, bounds[1] - 1e-6)
        found = scipy.optimize.least_squares(
            residual, inside, bounds=bounds, loss="soft_l1", f_scale=scale, diff_step=1e-4, max_nfev=40
        )
        return found.x, float(found.cost)

    attempts = []
    for start in starts:
        base = np.clip(space.unit_of_values(start), 0.0, 1.0)
        x, cost = solve(rough, np.concatenate([base[covered], np.zeros(len(NUISANCE_NAMES))]), base, 1.0)
        attempts.append((cost, x, base))
    _, x, base = min(attempts, key=lambda a: a[0])
    part, used = samples.rows(fine), keep[fine]
    for _ in range(2):
        residual = (part.load_nm - model.load_nm(part, *unpack(x, base)))[used]
        scale = max(1.4826 * float(np.median(np.abs(residual - np.median(residual)))), 1e-3)
        x, _ = solve(fine, x, base, scale)
    values, nuisance = unpack(x, base)
    return _with_errors(model, part, used, values, nuisance, covered)


def usable(samples: TorqueSamples) -> NDArray[np.bool_]:
    """Joints and rows whose friction has a known direction or is small beside the request, away from the joint stops.

    Shape (n, 12).
    """
    fast = np.abs(samples.velocity_rad_s) > MIN_SPEED_RAD_S
    above = samples.position_rad > facts.POSITION_LOW_RAD + STOP_MARGIN_RAD
    below = samples.position_rad < facts.POSITION_HIGH_RAD - STOP_MARGIN_RAD
    return (fast | (np.abs(samples.request_nm) > LARGE_REQUEST_NM)) & above & below


def _selection(samples: TorqueSamples, keep: NDArray[np.bool_], n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows for a fit: those with the largest requests in torque or power, and others evenly drawn."""
    total = len(samples)
    if total <= n:
        return np.arange(total)
    request = np.where(keep, samples.request_nm, 0.0)
    size = np.maximum(np.abs(request), request * samples.velocity_rad_s / 5.0)
    knees = size[:, 2::3].max(axis=1)
    n_large = int(LIMIT_SHARE * n)
    large = np.argpartition(-knees, n_large)[:n_large]
    rest = np.setdiff1d(np.arange(total), large)
    return np.sort(np.concatenate([large, rng.choice(rest, n - n_large, replace=False)]))


def _with_errors(
    model: TorqueModel,
    samples: TorqueSamples,
    used: NDArray[np.bool_],
    values: Array,
    nuisance: Array,
    covered: NDArray[np.bool_],
) -> TorqueFit:
    space = model.space
    indices = np.flatnonzero(covered)
    width = np.array([p.high - p.low for p in space.parameters])
    steps = np.concatenate([1e-3 * width[indices], 1e-2 * NUISANCE_SCALE])
    base = model.load_nm(samples, values, nuisance)
    residual = np.where(used, samples.load_nm - base, 0.0)
    scale = 1.4826 * float(np.median(np.abs(residual[used])))
    doubt = _relative_doubt(model, samples, values, nuisance, scale)
    residual = residual / doubt
    columns = []
    for j, step in enumerate(steps):
        plus, minus = (_shifted(space, values, nuisance, indices, j, sign * step) for sign in (1.0, -1.0))
        moved = (plus[0] - minus[0]).sum() + (plus[1] - minus[1]).sum()
        difference = model.load_nm(samples, *plus) - model.load_nm(samples, *minus)
        columns.append(np.where(used, difference / moved, 0.0) / doubt)
    jacobian = np.stack(columns, axis=-1)
    weight = 1.0 / np.sqrt(1.0 + (residual / scale) ** 2)

    legs = np.repeat(np.arange(facts.N_LEGS), 3)
    n_runs = int(samples.run.max()) + 1
    n_columns = jacobian.shape[-1]
    hessian = np.zeros((n_runs, facts.N_LEGS, n_columns, n_columns))
    gradient = np.zeros((n_runs, facts.N_LEGS, n_columns))
    for run in range(n_runs):
        rows = samples.run == run
        for leg in range(facts.N_LEGS):
            j = jacobian[rows][:, legs == leg].reshape(-1, n_columns)
            w = weight[rows][:, legs == leg].reshape(-1)
            r = residual[rows][:, legs == leg].reshape(-1)
            hessian[run, leg] = (j * w[:, None]).T @ j
            gradient[run, leg] = j.T @ (w * r)
    # A weak prior, one bounds' width wide, keeps what the samples say nothing about finite.
    prior = np.diag((scale / np.concatenate([width[indices], 100.0 * NUISANCE_SCALE])) ** 2)
    total = hessian.sum(axis=(0, 1)) + prior
    inverse = np.linalg.inv(total)
    by_leg = _spread(inverse, gradient.sum(axis=0))
    by_run = _spread(inverse, gradient.sum(axis=1))
    covariance = scale**2 * inverse
    statistical = np.maximum(np.diag(covariance), by_run)
    variance = statistical + by_leg

    n = space.n
    standard_error, alone = np.full(n, np.inf), np.full(n, np.inf)
    correlation = np.eye(n)
    active, runs = np.zeros(n, dtype=np.intp), np.zeros(n, dtype=np.intp)
    degrees = np.ones(n)
    deviations = np.sqrt(np.diag(covariance))
    for j, i in enumerate(indices):
        touched = np.abs(jacobian[..., j]) * width[i] > ACTIVE_NM
        active[i], runs[i] = touched.sum(), len(np.unique(samples.run[touched.any(axis=1)]))
        if active[i] == 0:
            continue
        standard_error[i] = np.sqrt(variance[j])
        alone[i] = scale / np.sqrt(total[j, j])
        # Welch and Satterthwaite: runs less one, and legs less one, each for its own share.
        shares = np.array([statistical[j], by_leg[j]]) / variance[j]
        degrees[i] = 1.0 / np.sum(shares**2 / np.array([max(n_runs - 1, 1), facts.N_LEGS - 1]))
        for k, other in enumerate(indices):
            correlation[i, other] = covariance[j, k] / (deviations[j] * deviations[k])
    return TorqueFit(
        values=values,
        covered=covered,
        standard_error=standard_error,
        alone_error=alone,
        correlation=correlation,
        active_samples=active,
        active_runs=runs,
        degrees_of_freedom=degrees,
        nuisance=nuisance,
        residual_nm=scale,
    )


def _relative_doubt(model: TorqueModel, samples: TorqueSamples, values: Array, nuisance: Array, scale: float) -> Array:
    """Standard deviation of each prediction, doubt about the velocity included, over the load's own; >= 1, (n, 12)."""
    step = 0.1
    faster, slower = (
        model.load_nm(replace(samples, velocity_rad_s=samples.velocity_rad_s + sign * step), values, nuisance)
        for sign in (1.0, -1.0)
    )
    slope = (faster - slower) / (2.0 * step)
    # Through a reversal the slope is that of the friction's jump, which says nothing about the doubt.
    slope = np.where(np.abs(samples.velocity_rad_s) > 2.0 * step, slope, samples.kd_nm_s_per_rad)
    # The same bend of the velocity makes the acceleration as doubtful over one period.
    inertia = model.inertia_kg_m2(values, nuisance) / (facts.STATE_PERIOD_NS * 1e-9)
    return np.sqrt(1.0 + (slope**2 + inertia**2) * (samples.velocity_doubt_rad_s / scale) ** 2)


def _shifted(
    space: SearchSpace, values: Array, nuisance: Array, indices: NDArray[np.intp], column: int, step: float
) -> tuple[Array, Array]:
    """One number moved by a step, or to the bound of the search if that is nearer."""
    values, nuisance = values.copy(), nuisance.copy()
    if column < len(indices):
        i = indices[column]
        moved = values.copy()
        moved[i] += step
        values[i] = space.within_bounds(moved)[i]
    else:
        nuisance[column - len(indices)] += step
    return values, nuisance


def _spread(inverse: Array, gradients: Array) -> Array:
    """Variance of the estimate from how far groups pull it apart (sandwich estimate), shape (n_columns,).

    Args:
        inverse: Inverse of the summed curvature. Shape (n_columns, n_columns).
        gradients: Of each group at the estimate. Shape (n_groups, n_columns).
    """
    n = len(gradients)
    moves = gradients @ inverse
    return np.asarray(n / max(n - 1, 1) * np.sum(moves**2, axis=0))
