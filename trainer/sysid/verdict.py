"""The verdict on each parameter: its intervals, whether it is identified, by what, how closely, or why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy.optimize

from spot_model.robot.facts import Array
from spot_model.robot.joints import select_joints
from trainer.sysid.config import SearchParameter, SearchSpace
from trainer.sysid.search import CandidateResult, SysidProblem
from trainer.sysid.torque_fit import TorqueFit, usable
from trainer.sysid.torque_model import TorqueModel, TorqueSamples

BEST_SHARE: Final = 0.5
"""Share of the evaluations, the best ones, that the surrogate is fitted to."""


@dataclass(frozen=True)
class ScoreIntervals:
    """Where the score's minimum lies, as far as repeats and the chaos of the runs allow to tell."""

    best: Array
    """Physical values at the surrogate's minimum, shape (n,)."""
    low: Array
    high: Array


def score_intervals(
    problem: SysidProblem, unit: Array, results: Sequence[CandidateResult], confidence: float, rng: np.random.Generator
) -> ScoreIntervals | None:
    """Resample real runs and evaluations, refit the surrogate each time, and take quantiles of its minimum.

    Args:
        problem: What was searched.
        unit: Evaluated points of the unit cube, shape (n_evaluations, n).
        results: Their results.
        confidence: Of the central interval, for instance 0.9.
        rng: Source of the resampling.

    Returns:
        The intervals, or None where no sequence has repeats or too few evaluations are finite.
    """
    n_real = [len(reference.real) for reference in problem.references]
    if max(n_real) < 2:
        return None
    distances = [np.stack([r.distances[i] for r in results]) for i in range(len(n_real))]
    by_real = [
        (d.mean(axis=1) / reference.scale).mean(axis=-1)
        for d, reference in zip(distances, problem.references, strict=True)
    ]
    weights = np.array(problem.sequence_weights)

    def scores(real_weights: Sequence[Array]) -> Array:
        return np.asarray(sum(w * (b @ r) for w, b, r in zip(weights, by_real, real_weights, strict=True)))

    plain = scores([np.full(n, 1.0 / n) for n in n_real])
    finite = np.flatnonzero(np.isfinite(plain))
    n_terms = _terms(unit[:1]).shape[1]
    kept = finite[np.argsort(plain[finite])[: max(int(BEST_SHARE * len(finite)), 2 * n_terms)]]
    if len(kept) < 2 * n_terms:
        return None
    minima = []
    for _ in range(200):
        drawn = [rng.multinomial(n, np.full(n, 1.0 / n)) / n for n in n_real]
        rows = rng.choice(kept, len(kept))
        minima.append(_minimum(unit[rows], scores(drawn)[rows]))
    tail = (1.0 - confidence) / 2.0
    values = problem.space.values_of_unit(np.array(minima))
    low, high = np.quantile(values, [tail, 1.0 - tail], axis=0)
    return ScoreIntervals(problem.space.values_of_unit(_minimum(unit[kept], plain[kept])), low, high)


def _terms(unit: Array) -> Array:
    n = unit.shape[1]
    first, second = np.triu_indices(n)
    centred = unit - 0.5
    return np.concatenate([np.ones((len(unit), 1)), centred, centred[:, first] * centred[:, second]], axis=1)


def _minimum(unit: Array, score: Array) -> Array:
    """Minimum of a ridge-fitted quadratic within the box of the points, shape (n,)."""
    n = unit.shape[1]
    terms = _terms(unit)
    penalty = 1e-3 * len(unit) * np.diag([0.0] + [1.0] * (terms.shape[1] - 1))
    coefficients = np.linalg.solve(terms.T @ terms + penalty, terms.T @ score)
    gradient = coefficients[1 : n + 1]
    hessian = np.zeros((n, n))
    hessian[np.triu_indices(n)] = coefficients[n + 1 :]
    hessian = hessian + hessian.T
    values, vectors = np.linalg.eigh(hessian)
    hessian = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    low, high = unit.min(axis=0) - 0.5, unit.max(axis=0) - 0.5
    start = np.clip(unit[np.argmin(score)] - 0.5, low, high)
    found = scipy.optimize.minimize(
        lambda x: gradient @ x + 0.5 * x @ hessian @ x,
        start,
        jac=lambda x: gradient + hessian @ x,
        bounds=list(zip(low, high, strict=True)),
        method="L-BFGS-B",
    )
    return np.asarray(found.x + 0.5)


CONFIDENCE: Final = 0.9
RELATIVE_LIMIT: Final = 0.10
"""Half the interval may be at most this share of the value, else the parameter does not count as identified."""
FRICTION_LIMIT_NM: Final = 0.05
"""For friction levels, which may be next to nothing: this much in any case."""
SYSTEMATIC_SHARE: Final = 0.015
SYSTEMATIC_FRICTION_NM: Final = 0.015
"""What differing time steps, contact and friction laws of robot and model leave uncertain, however long the log;
found by planting known values in simulations of other step, integrator and contact. Standard deviations.
"""
MIN_ACTIVE: Final = 30
MIN_RUNS: Final = 2
"""A parameter needs this many samples that depend on it, in this many runs."""

MIN_INDEPENDENT: Final = 30.0
"""As many, in effect, must tell it from the other parameters: of 138 samples on a falling line 13 and 25 once misplaced
its corner, with a narrow interval; corners that runs do reach have 50 and more.
"""

Source = Literal["measured torque", "distributions", "not identified"]


@dataclass(frozen=True)
class Estimate:
    """A value with its 90 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ParameterVerdict:
    """What is known about one parameter."""

    name: str
    """Effect, joints and parameter."""
    unit: str
    """Its unit."""
    initial: float
    """Where the search started."""
    value: float
    """For the model file; where the parameter is not identified, a value that the logs do not contradict."""
    low: float
    """Lower end of its 90 % interval."""
    high: float
    """Upper end."""
    identified: bool
    """Whether the logs determine it."""
    source: Source
    """``measured torque``, ``distributions``, or ``not identified``."""
    reason: str
    """Why it is identified, or is not."""
    by_search: Estimate
    """From the distributions of joint position, velocity and action: the paper's method."""
    by_torque: Estimate | None
    """From the measured torques; None where they do not depend on it."""


def judge_parameters(
    model: TorqueModel,
    samples: TorqueSamples | None,
    fit: TorqueFit | None,
    search_mean: Array,
    intervals: ScoreIntervals | None,
) -> tuple[ParameterVerdict, ...]:
    """Decide for every parameter of the space.

    Args:
        model: The space with the model that predicts torque.
        samples: Torque samples; None without measured load.
        fit: Fit to them; None without.
        search_mean: Mean of the search's final distribution, physical values, shape (n,).
        intervals: Of the score's minimum; None without repeats.
    """
    return tuple(_verdict(model, samples, fit, search_mean, intervals, i) for i in range(model.space.n))


def _verdict(
    model: TorqueModel,
    samples: TorqueSamples | None,
    fit: TorqueFit | None,
    search_mean: Array,
    intervals: ScoreIntervals | None,
    i: int,
) -> ParameterVerdict:
    p = model.space.parameters[i]
    by_search, by_torque = _search_estimate(p, i, search_mean, intervals), _torque_estimate(p, i, fit)

    def made(estimate: Estimate, value: float, source: Source, reason: str) -> ParameterVerdict:
        return ParameterVerdict(
            name=p.name,
            unit=p.unit,
            initial=p.initial,
            value=value,
            low=estimate.low,
            high=estimate.high,
            identified=source != "not identified",
            source=source,
            reason=reason,
            by_search=by_search,
            by_torque=by_torque,
        )

    if by_torque is not None and fit is not None and samples is not None:
        enough = fit.errors.active_samples[i] >= MIN_ACTIVE and fit.errors.active_runs[i] >= MIN_RUNS
        independent = fit.errors.independent_samples[i]
        if enough and independent >= MIN_INDEPENDENT and is_narrow(p, by_torque):
            reason = (
                f"{fit.errors.active_samples[i]} samples of {fit.errors.active_runs[i]} runs depend on it, "
                f"effectively {independent:.0f} of them on it alone"
            )
            return made(by_torque, by_torque.value, "measured torque", reason)
        reason = why_not(model.space, fit, samples, i, enough=bool(enough))
        return made(by_torque, kept_value(model, samples, fit, i), "not identified", reason)
    if intervals is not None and is_narrow(p, by_search):
        return made(by_search, by_search.value, "distributions", "the score has a clear minimum")
    reason = (
        "without repeats there is no interval"
        if intervals is None
        else "the score hardly changes with it: the runs do not excite it"
    )
    return made(by_search, by_search.value, "not identified", reason)


def is_narrow(p: SearchParameter, estimate: Estimate) -> bool:
    """Whether the interval is narrow enough to call the parameter identified."""
    half = (estimate.high - estimate.low) / 2.0
    friction = FRICTION_LIMIT_NM if p.parameter == "level_nm" else 0.0
    return bool(half <= max(RELATIVE_LIMIT * abs(estimate.value), friction))


def why_not(space: SearchSpace, fit: TorqueFit, samples: TorqueSamples, i: int, *, enough: bool) -> str:
    """In words, why the torques do not tell parameter ``i``."""
    p = space.parameters[i]
    n, runs = int(fit.errors.active_samples[i]), int(fit.errors.active_runs[i])
    if n == 0:
        return f"never reached: no sample depends on it; {_reached(p, samples)}"
    if runs < MIN_RUNS and n >= MIN_ACTIVE:
        return f"only one run depends on it ({n} samples); {MIN_RUNS} runs are needed to check it"
    if not enough:
        needed = f"{MIN_ACTIVE} of {MIN_RUNS} runs are needed"
        return f"hardly reached: {n} samples of {runs} runs depend on it, {needed}; {_reached(p, samples)}"
    others = np.abs(fit.errors.correlation[i]).copy()
    others[i] = 0.0
    partner = int(np.argmax(others))
    if others[partner] > 0.8:
        return (
            f"only together with {space.parameters[partner].parameter}: the {n} samples that depend on both allow many "
            f"pairs (correlation {fit.errors.correlation[i, partner]:+.2f})"
        )
    independent = fit.errors.independent_samples[i]
    if independent < MIN_INDEPENDENT:
        return (
            f"{n} samples of {runs} runs depend on it, but effectively only {independent:.0f} distinguish it from the "
            f"others; {MIN_INDEPENDENT:.0f} are needed"
        )
    if not np.isfinite(fit.errors.standard_error[i]):
        return f"{n} samples of {runs} runs depend on it, but values far from it fit them as well"
    return f"{n} samples of {runs} runs depend on it, but they do not agree closely enough"


def kept_value(model: TorqueModel, samples: TorqueSamples, fit: TorqueFit, i: int) -> float:
    """The initial value where the torques do not contradict it, else the fitted one."""
    initial = fit.values.copy()
    initial[i] = model.space.parameters[i].initial
    initial = model.space.within_bounds(initial)
    some = samples.rows(np.arange(0, len(samples), max(1, len(samples) // 20_000)))
    moved = model.load_nm(some, initial, fit.nuisance) - model.load_nm(some, fit.values, fit.nuisance)
    worse = np.abs(moved[usable(some)])
    is_free = initial[i] == model.space.parameters[i].initial and np.sqrt(np.mean(worse**2)) < 0.02 * fit.residual_nm
    return float(initial[i] if is_free else fit.values[i])


def _search_estimate(p: SearchParameter, i: int, mean: Array, intervals: ScoreIntervals | None) -> Estimate:
    if intervals is None:
        return Estimate(float(mean[i]), p.low, p.high)
    low, high = min(intervals.low[i], mean[i]), max(intervals.high[i], mean[i])
    return Estimate(float(mean[i]), float(low), float(high))


def _torque_estimate(p: SearchParameter, i: int, fit: TorqueFit | None) -> Estimate | None:
    if fit is None or not fit.covered[i]:
        return None
    value = float(fit.values[i])
    floor = SYSTEMATIC_FRICTION_NM if p.parameter == "level_nm" else SYSTEMATIC_SHARE * abs(value)
    half = float(np.hypot(fit.half_width(CONFIDENCE)[i], 1.645 * floor))
    if not np.isfinite(half):
        return Estimate(value, p.low, p.high)
    return Estimate(value, max(p.low, value - half), min(p.high, value + half))


def _reached(p: SearchParameter, samples: TorqueSamples) -> str:
    mask = select_joints(p.joints)
    request, velocity = samples.request_nm[:, mask], samples.velocity_rad_s[:, mask]
    sign = -1.0 if "min" in p.parameter else 1.0
    driving = sign * request[sign * velocity > 0.0]
    if not driving.size:
        return "these joints never drove in its direction"
    top = sign * float(np.quantile(driving, 0.999))
    fastest = sign * float(np.quantile(sign * velocity, 0.999))
    return f"asked for at most {top:.0f} N·m while driving, at up to {fastest:.0f} rad/s (99.9 % of samples)"
