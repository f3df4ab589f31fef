"""Parameters from measured torque: robust least squares on predicted against measured load.

Limits come from single samples; friction, viscosity and inertia from stretches of them (torque_losses).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy.optimize
import scipy.stats
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.sysid.torque_errors import FitErrors, effective_freedom, fit_errors, slopes_of_values
from trainer.sysid.torque_losses import LossFit, fit_losses
from trainer.sysid.torque_model import MIN_SPEED_RAD_S, NUISANCE_NAMES, NUISANCE_SCALE, TorqueModel, TorqueSamples

LARGE_REQUEST_NM: Final = 20.0
"""Requests from here on are kept at any speed: friction is small beside them."""
SLOPE_DOUBT: Final = 0.05
"""Share of an acceleration that five samples may get wrong. Without it, a few reversals at 700 rad/s² looked like a
limit that was never met.
"""
N_FINE: Final = 40_000
"""Rows of the rough fit from several starts, and of the final one."""
N_ELSEWHERE: Final = 8_000
"""Rows of the fits that hold a limit elsewhere."""
FAR_ERRORS: Final = 10.0
"""A limit is held so many standard errors to either side of its estimate."""
AS_GOOD_NATS: Final = 10.0
"""So little more than the fit's may such a fit cost and still be as good; 50 are due by the standard error."""
LARGE_SHARE: Final = 0.3
"""Share of the rows that are the largest requests, the rest evenly drawn."""


@dataclass(frozen=True)
class TorqueFit:
    """What the torque samples say about each parameter of the search space."""

    values: Array
    """Shape (n,); the starting value where the samples say nothing."""
    covered: NDArray[np.bool_]
    """Parameters that this fit moved, shape (n,)."""
    errors: FitErrors
    nuisance: Array
    """In the order of :data:`~trainer.sysid.torque_model.NUISANCE_NAMES`."""
    residual_nm: float
    """Robust scale of what remains."""

    def half_width(self, confidence: float) -> Array:
        """Half the width of the central interval, shape (n,); infinite where the samples say nothing."""
        quantile = scipy.stats.t.ppf(0.5 + confidence / 2.0, self.errors.degrees_of_freedom)
        return np.asarray(self.errors.standard_error * quantile)


def fit_torque(
    model: TorqueModel, samples: TorqueSamples, starts: Sequence[Array], rng: np.random.Generator
) -> TorqueFit:
    """Fit by soft-L1 least squares; the best of several starts."""
    keep = usable(samples)
    rough, fine = (_selection(samples, keep, n, rng) for n in (2_500, N_FINE))
    attempts = []
    some, none = samples.rows(rough), np.zeros(len(NUISANCE_NAMES))
    for start in starts:
        unit = np.clip(model.space.unit_of_values(start), 0.0, 1.0)
        doubt = relative_doubt(model, some, unit, none, 1.0)
        attempts.append(_solve(model, some, keep[rough], unit, none, scale=1.0, doubt=doubt))
    _, unit, nuisance = min(attempts, key=lambda a: a[0])
    part, used = samples.rows(fine), keep[fine]
    for _ in range(2):
        scale = _scale(model, part, used, unit, nuisance)
        doubt = relative_doubt(model, part, unit, nuisance, scale)
        _, unit, nuisance = _solve(model, part, used, unit, nuisance, scale=scale, doubt=doubt)
    scale = _scale(model, part, used, unit, nuisance)
    doubt = relative_doubt(model, part, unit, nuisance, scale)
    fit = TorqueFit(
        values=model.space.values_of_unit(unit),
        covered=model.covered,
        errors=fit_errors(model, part, used, unit, nuisance, doubt, scale),
        nuisance=nuisance,
        residual_nm=scale,
    )
    fit = replace(fit, errors=_open_ended(model, part, used, fit, unit))
    losses = fit_losses(model, samples, fit.values, float(nuisance[0]))
    return fit if losses is None else _with_losses(model, fit, losses)


def _open_ended(
    model: TorqueModel, samples: TorqueSamples, used: NDArray[np.bool_], fit: TorqueFit, unit: Array
) -> FitErrors:
    """The errors, infinite for limits that may as well be far from their estimate.

    A standard error knows the curvature at the estimate alone. A corner that no sample reaches slides along a line that
    many samples tell, at next to no cost.
    """
    errors, space = fit.errors, model.space
    rows = _selection(samples, used, N_ELSEWHERE, np.random.default_rng(0))
    doubt = relative_doubt(model, samples.rows(rows), unit, fit.nuisance, fit.residual_nm)
    solve = partial(_solve, model, samples.rows(rows), used[rows], scale=fit.residual_nm, doubt=doubt)
    least, best, nuisance = solve(unit, fit.nuisance)
    standard_error, per_unit = errors.standard_error.copy(), np.abs(np.diag(slopes_of_values(space, unit)))
    is_limit = np.array([p.effect_index in model.torque_effects for p in space.parameters])
    for i in np.flatnonzero(np.isfinite(standard_error) & is_limit):
        far = FAR_ERRORS * errors.standard_error[i] / per_unit[i]
        for place in (best[i] - far, best[i] + far):
            if 0.0 <= place <= 1.0:
                cost, _, _ = solve(np.where(np.arange(space.n) == i, place, best), nuisance, held=int(i))
                if cost - least < AS_GOOD_NATS * fit.residual_nm**2:
                    standard_error[i] = np.inf
    return replace(errors, standard_error=standard_error)


def _with_losses(model: TorqueModel, fit: TorqueFit, losses: LossFit) -> TorqueFit:
    """The same fit with friction and inertia from whole stretches, which are free of what slopes of noise cost."""
    i, errors = list(losses.columns), fit.errors
    values, nuisance = fit.values.copy(), fit.nuisance.copy()
    values[i], nuisance[1:3], nuisance[3:5] = losses.values, losses.viscosity_nm_s_per_rad, losses.inertia_kg_m2
    statistical, by_leg = np.diag(losses.by_run), np.diag(losses.by_leg)
    standard_error, freedom = errors.standard_error.copy(), errors.degrees_of_freedom.copy()
    standard_error[i] = np.sqrt(statistical + by_leg)
    freedom[i] = effective_freedom(statistical, by_leg, int(losses.n_runs.max(initial=2)))
    samples, runs = errors.active_samples.copy(), errors.active_runs.copy()
    samples[i], runs[i] = losses.n_windows, losses.n_runs
    independent = errors.independent_samples.copy()
    independent[i] = losses.n_windows
    errors = replace(
        errors,
        standard_error=standard_error,
        degrees_of_freedom=freedom,
        active_samples=samples,
        active_runs=runs,
        independent_samples=independent,
    )
    return replace(fit, values=model.space.within_bounds(values), nuisance=nuisance, errors=errors)


def usable(samples: TorqueSamples) -> NDArray[np.bool_]:
    """Joints and rows whose friction has a known direction or is small beside the request, away from the joint stops.

    Shape (n, 12).
    """
    fast = np.abs(samples.velocity_rad_s) > MIN_SPEED_RAD_S
    return (fast | (np.abs(samples.request_nm) > LARGE_REQUEST_NM)) & samples.is_off_the_stops


def relative_doubt(model: TorqueModel, samples: TorqueSamples, unit: Array, nuisance: Array, scale: float) -> Array:
    """Standard deviation of each prediction, doubt about the velocity included, over the load's own; >= 1, (n, 12)."""
    step, values = 0.1, model.space.values_of_unit(unit)
    faster, slower = (
        model.load_nm(replace(samples, velocity_rad_s=samples.velocity_rad_s + sign * step), values, nuisance)
        for sign in (1.0, -1.0)
    )
    slope = (faster - slower) / (2.0 * step)
    # Through a reversal the slope is that of the friction's jump, which says nothing about the doubt.
    slope = np.where(np.abs(samples.velocity_rad_s) > 2.0 * step, slope, samples.kd_nm_s_per_rad)
    # The same bend of the velocity makes the acceleration as doubtful over one period.
    inertia = model.inertia_kg_m2(values, nuisance)
    per_period = inertia / (facts.STATE_PERIOD_NS * 1e-9)
    bent = (slope**2 + per_period**2) * (samples.velocity_doubt_rad_s / scale) ** 2
    reversing = (SLOPE_DOUBT * inertia * samples.acceleration_rad_s2 / scale) ** 2
    return np.asarray(np.sqrt(1.0 + bent + reversing))


def _solve(
    model: TorqueModel,
    samples: TorqueSamples,
    used: NDArray[np.bool_],
    unit: Array,
    nuisance: Array,
    *,
    scale: float,
    doubt: Array,
    held: int | None = None,
) -> tuple[float, Array, Array]:
    """Cost, unit coordinates and nuisance at the minimum nearby; ``held`` is a parameter that stays as it is."""
    covered = model.covered.copy()
    if held is not None:
        covered[held] = False
    n = int(covered.sum())
    columns = np.concatenate([np.flatnonzero(covered), model.space.n + np.arange(len(NUISANCE_NAMES))])

    def unpack(x: Array) -> tuple[Array, Array]:
        moved = unit.copy()
        moved[covered] = x[:n]
        return moved, x[n:] * NUISANCE_SCALE

    def residual(x: Array) -> Array:
        moved, extra = unpack(x)
        predicted = model.load_nm(samples, model.space.values_of_unit(moved), extra)
        return np.asarray(((samples.load_nm - predicted) / doubt)[used])

    def slopes(x: Array) -> Array:
        jacobian = model.jacobian(samples, *unpack(x))
        return np.asarray(-(jacobian[used][:, columns]) / doubt[used][:, None])

    free = np.full(len(NUISANCE_NAMES), np.inf)
    low, high = np.concatenate([np.zeros(n), -free]), np.concatenate([np.ones(n), free])
    start = np.clip(np.concatenate([unit[covered], nuisance / NUISANCE_SCALE]), low + 1e-6, high - 1e-6)
    found = scipy.optimize.least_squares(
        residual, start, slopes, bounds=(low, high), loss="soft_l1", f_scale=scale, max_nfev=40, ftol=1e-7, xtol=1e-6
    )
    return float(found.cost), *unpack(found.x)


def _scale(model: TorqueModel, samples: TorqueSamples, used: NDArray[np.bool_], unit: Array, nuisance: Array) -> float:
    """Robust standard deviation of the residual."""
    residual = (samples.load_nm - model.load_nm(samples, model.space.values_of_unit(unit), nuisance))[used]
    return max(1.4826 * float(np.median(np.abs(residual - np.median(residual)))), 1e-3)


def _selection(samples: TorqueSamples, keep: NDArray[np.bool_], n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows for a fit: those with the largest requests in torque or power, and others evenly drawn."""
    total = len(samples)
    if total <= n:
        return np.arange(total)
    request = np.where(keep, samples.request_nm, 0.0)
    size = np.maximum(np.abs(request), request * samples.velocity_rad_s / 5.0)
    knees = size[:, 2::3].max(axis=1)
    n_large = int(LARGE_SHARE * n)
    large = np.argpartition(-knees, n_large)[:n_large]
    rest = np.setdiff1d(np.arange(total), large)
    return np.sort(np.concatenate([large, rng.choice(rest, n - n_large, replace=False)]))
