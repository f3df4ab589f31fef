"""Standard errors of a torque fit, clustered by runs and by legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.sysid.config import SearchSpace
from trainer.sysid.torque_model import NUISANCE_NAMES, TorqueModel, TorqueSamples

ACTIVE_NM: Final = 0.3
"""A sample bears on a parameter if the parameter's whole width of bounds, at the local slope, moves it by this."""
TRUSTED_DOUBT: Final = 2.5
"""A sample whose prediction is more doubtful than so many times the load itself bears on nothing."""
WIDE: Final = 100.0
"""Prior standard deviation of a nuisance number, in its usual size."""


@dataclass(frozen=True)
class FitErrors:
    """For each parameter of the search space, shape (n,) if nothing else is said."""

    standard_error: Array
    """Infinite where the samples say nothing."""
    degrees_of_freedom: Array
    """For Student's t."""
    correlation: Array
    """Between the estimates, shape (n, n)."""
    active_samples: NDArray[np.intp]
    """Samples that depend on it."""
    active_runs: NDArray[np.intp]
    """Runs that have such samples."""
    independent_samples: Array
    """How many samples, in effect, tell it from all others: many may bear on two parameters, and few part them."""


def fit_errors(
    model: TorqueModel,
    samples: TorqueSamples,
    used: NDArray[np.bool_],
    unit: Array,
    nuisance: Array,
    doubt: Array,
    scale: float,
) -> FitErrors:
    """Errors from how far whole runs pull the answer apart, and legs beside them (sandwich estimates).

    Samples within a run are not independent, so a run counts as one; legs that disagree are a sign of what the model
    lacks, and add to it.

    Args:
        model: Predicts load.
        samples: Rows of the fit.
        used: Which joints and rows count, shape (n_rows, 12).
        unit: Estimate in the unit cube, shape (n,).
        nuisance: Estimate of the nuisance numbers.
        doubt: Each prediction's standard deviation over the load's own, shape (n_rows, 12).
        scale: Standard deviation of the residual.
    """
    space = model.space
    values = space.values_of_unit(unit)
    raw = model.jacobian(samples, unit, nuisance) * used[..., None]
    residual = np.where(used, (samples.load_nm - model.load_nm(samples, values, nuisance)) / doubt, 0.0)
    jacobian = raw / doubt[..., None]
    weight = 1.0 / np.sqrt(1.0 + (residual / scale) ** 2)
    by_cell = np.einsum("nljc,nlj->nlc", _legs(jacobian), _legs(weight * residual))
    runs = np.unique(samples.run, return_inverse=True)[1]
    gradient = np.zeros((int(runs.max()) + 1, facts.N_LEGS, jacobian.shape[-1]))
    np.add.at(gradient, runs, by_cell)
    # A weak prior, one bounds' width wide, keeps what the samples say nothing about finite.
    prior = scale**2 * np.concatenate([np.ones(space.n), np.full(len(NUISANCE_NAMES), WIDE**-2.0)])
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    inverse: Array = np.linalg.inv((flat * weight.reshape(-1, 1)).T @ flat + np.diag(prior)).astype(np.float64)
    likely = scale**2 * inverse
    parting = weight.reshape(-1, 1) * (flat @ inverse[:, : space.n]) ** 2
    spreads = [_spread(inverse, gradient.sum(axis=axis)) for axis in (1, 0)]

    to_values = slopes_of_values(space, unit)
    covariance = to_values @ likely[: space.n, : space.n] @ to_values.T
    by_run, by_leg = (np.diag(to_values @ s[: space.n, : space.n] @ to_values.T) for s in spreads)
    statistical = np.maximum(np.diag(covariance), by_run)
    touched = (np.abs(raw[..., : space.n]) > ACTIVE_NM) & (doubt[..., None] < TRUSTED_DOUBT)
    active = touched.sum(axis=(0, 1))
    active_runs = np.array([len(np.unique(samples.run[touched[..., i].any(axis=1)])) for i in range(space.n)])
    deviations = np.sqrt(np.diag(covariance))
    return FitErrors(
        standard_error=np.where(active > 0, np.sqrt(statistical + by_leg), np.inf),
        degrees_of_freedom=effective_freedom(statistical, by_leg, len(gradient)),
        correlation=covariance / np.outer(deviations, deviations),
        active_samples=active,
        active_runs=active_runs,
        independent_samples=parting.sum(axis=0) ** 2 / np.maximum((parting**2).sum(axis=0), np.finfo(float).tiny),
    )


def effective_freedom(statistical: Array, by_leg: Array, n_runs: int) -> Array:
    """Degrees of freedom of a sum of two variances, by Welch and Satterthwaite: runs less one, and legs less one."""
    total = statistical + by_leg
    known = np.isfinite(total) & (total > 0.0)
    shares = np.stack([statistical, by_leg])[:, known] / total[known]
    freedom = np.ones(len(total))
    freedom[known] = 1.0 / np.sum(shares**2 / np.array([[max(n_runs - 1, 1)], [facts.N_LEGS - 1]]), axis=0)
    return freedom


def cluster_covariances(
    scores: Array, inverse: Array, scale: float, run: NDArray[np.intp], leg: NDArray[np.intp]
) -> tuple[Array, Array, Array]:
    """Covariances of a linear fit: as if samples were independent, by runs, and by legs; (c, c) each.

    Args:
        scores: Weighted residual times slopes of each sample. Shape (n, c).
        inverse: Inverse of the weighted curvature. Shape (c, c).
        scale: Standard deviation of the residual.
        run: Shape (n,).
        leg: Shape (n,).
    """
    spreads = []
    for group in (run, leg):
        number = np.unique(group, return_inverse=True)[1]
        gradients = np.zeros((int(number.max()) + 1, scores.shape[1]))
        np.add.at(gradients, number, scores)
        spreads.append(_spread(inverse, gradients))
    return scale**2 * inverse, spreads[0], spreads[1]


def _legs(values: Array) -> Array:
    """Split the axis of twelve joints into legs and their joints."""
    return values.reshape(len(values), facts.N_LEGS, 3, *values.shape[2:])


def _spread(inverse: Array, gradients: Array) -> Array:
    """Covariance of the estimate from how far groups pull it apart.

    Args:
        inverse: Inverse of the summed curvature. Shape (c, c).
        gradients: Of each group at the estimate. Shape (n_groups, c).
    """
    n = len(gradients)
    moves = gradients @ inverse
    return np.asarray(n / max(n - 1, 1) * moves.T @ moves)


def slopes_of_values(space: SearchSpace, unit: Array) -> Array:
    """Slopes of the physical values by the unit cube's coordinates, shape (n, n)."""
    step = 1e-6
    columns = []
    for i in range(space.n):
        moved = unit.copy()
        moved[i] += step
        columns.append((space.values_of_unit(moved) - space.values_of_unit(unit)) / step)
    return np.stack(columns, axis=1)
