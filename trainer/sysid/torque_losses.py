"""Friction, viscosity and inertia from stretches of motion: a balance of impulse that needs no derivative.

Over five neighbouring states under one set-point, the motor's mean torque less the mean load is what friction and
viscosity take, and what changes the rotor's momentum. Velocities at both ends give that change exactly, where a slope
through noisy samples would be too small at every bend; and what is too small in inertia reappears as friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.friction import CoulombFriction
from spot_model.plant.model_fields import LossMotion, joint_losses_nm
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.joints import select_joints
from trainer.sysid.config import SearchSpace
from trainer.sysid.torque_errors import cluster_covariances
from trainer.sysid.torque_model import (
    BEND_WEIGHTS,
    MIN_SPEED_RAD_S,
    TURNING_TIME_S,
    TorqueModel,
    TorqueSamples,
    shifted_motion,
)

WIDTH: Final = 5
SIMPSON: Final = np.array([1.0, 4.0, 2.0, 4.0, 1.0]) / 12.0
"""Mean of a smooth signal over five evenly spaced samples; exact for cubics."""
PERIOD_S: Final = facts.STATE_PERIOD_NS * 1e-9
CALM_REQUEST_NM: Final = 40.0
CALM_SPEED_RAD_S: Final = 12.0
"""Joints that are asked for less and move slower are far from most limits; those that meet one are left out."""
STEADY_RAD_S2: Final = 100.0
"""A joint that accelerates more is left out too: its inertia outweighs its friction by far."""
TYPICAL_INERTIA_KG_M2: Final = 0.06
LOAD_DOUBT_NM: Final = 0.5
"""A bend of the velocity that means this much torque on a typical rotor halves a window's weight."""


@dataclass(frozen=True)
class LossFit:
    """What windows say about friction, viscosity and inertia."""

    columns: tuple[int, ...]
    """Which parameters of the search space the first columns are."""
    values: Array
    """Theirs, shape (n,)."""
    by_run: Array
    """Covariance from how far whole runs pull them apart, or the likely one where that is larger. Shape (n, n)."""
    by_leg: Array
    n_windows: NDArray[np.intp]
    """Windows that bear on each, shape (n,)."""
    n_runs: NDArray[np.intp]
    inertia_kg_m2: Array
    """Inertia of hips and knees, beside what the model holds; shape (2,)."""
    viscosity_nm_s_per_rad: Array
    """Viscosity of hips and knees, beside what the model holds; shape (2,)."""
    residual_nm: float


@dataclass(frozen=True)
class _Windows:
    run: NDArray[np.intp]
    excess_nm: Array
    """Mean motor torque less mean load, shape (n, 12)."""
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    weight: Array
    """0 for joints that turn round, stand, meet a limit or a joint stop."""


def fit_losses(model: TorqueModel, samples: TorqueSamples, values: Array, offset_s: float) -> LossFit | None:
    """Fit by robust linear least squares.

    Args:
        model: The space, whose torque effects tell where a limit is met.
        samples: In the order of the logs.
        values: Present estimate, shape (n_parameters,).
        offset_s: How much earlier than a sample its load was made.

    Returns:
        None where there are too few windows.
    """
    windows = _windows(model, samples, values, offset_s)
    used = windows.weight > 0.0
    columns, indices = _columns(model.space, windows)
    enough = used.sum() >= 100 and len(np.unique(windows.run[used.any(axis=1)])) >= 2
    if not enough:
        return None
    excess = windows.excess_nm - _known_losses(model.space, values, windows)
    x = columns[used]
    bears = np.abs(x).sum(axis=0) > 0.0
    x, y, prior = x[:, bears], excess[used], windows.weight[used]
    weight = prior
    for _ in range(20):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(x * root[:, None], y * root, rcond=None)[0]
        residual = y - x @ solution
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-6)
        weight = prior / np.sqrt(1.0 + (residual / scale) ** 2)
    rows, joints = np.nonzero(used)
    inverse = np.asarray(np.linalg.inv((x * weight[:, None]).T @ x), dtype=np.float64)
    # Of a sample with weight 1; neighbouring windows share all but one of their states.
    own_scale = float(np.sqrt(WIDTH * np.mean(weight * residual**2)))
    likely, by_run, by_leg = cluster_covariances(
        x * (weight * residual)[:, None], inverse, own_scale, windows.run[rows], joints // 3
    )
    full = np.zeros(columns.shape[-1])
    full[bears] = solution
    n = len(indices)
    covariance = [np.diag(np.full(n, np.inf)) for _ in range(2)]
    kept = np.flatnonzero(bears[:n])
    wider = np.where(np.eye(len(likely), dtype=np.bool_), np.maximum(likely, by_run), by_run)
    for out, found in zip(covariance, (wider, by_leg), strict=True):
        out[np.ix_(kept, kept)] = found[: len(kept), : len(kept)]
    touched = used[..., None] & (columns[..., :n] != 0.0)
    return LossFit(
        columns=indices,
        values=full[:n],
        by_run=covariance[0],
        by_leg=covariance[1],
        n_windows=touched.sum(axis=(0, 1)),
        n_runs=np.array([len(np.unique(windows.run[touched[..., i].any(axis=1)])) for i in range(n)], dtype=np.intp),
        viscosity_nm_s_per_rad=full[n : n + 2],
        inertia_kg_m2=full[n + 2 : n + 4],
        residual_nm=scale,
    )


def window_starts(samples: TorqueSamples) -> NDArray[np.intp]:
    """Rows with which five neighbouring states of one run, under one set-point, begin."""
    if len(samples) < WIDTH:
        return np.zeros(0, dtype=np.intp)
    last = WIDTH - 1
    joined = (samples.state[last:] - samples.state[:-last] == last) & (samples.run[last:] == samples.run[:-last])
    steady = np.all(samples.setpoint_rad[last:] == samples.setpoint_rad[:-last], axis=1)
    return np.flatnonzero(joined & steady)


def _windows(model: TorqueModel, samples: TorqueSamples, values: Array, offset_s: float) -> _Windows:
    starts = window_starts(samples)
    at_samples = shifted_motion(samples, offset_s)
    request = samples.asked_nm(at_samples.position_rad, at_samples.velocity_rad_s)
    touched = np.abs(model.motor_torque_nm(samples, values, at_samples) - request) > 1e-6

    def gathered(x: NDArray[np.float64]) -> Array:
        return np.stack([x[starts + k] for k in range(WIDTH)])

    def mean(x: Array) -> Array:
        return np.asarray(np.tensordot(SIMPSON, gathered(x), axes=1))

    velocity = gathered(samples.velocity_rad_s)
    # The motion within the window alone, as the set-points before and after it accelerate otherwise.
    acceleration = (velocity[-1] - velocity[0]) / ((WIDTH - 1) * PERIOD_S)
    jerk = np.tensordot(BEND_WEIGHTS, velocity, axes=1) / PERIOD_S**2
    mean_velocity = np.tensordot(SIMPSON, velocity, axes=1) - offset_s * acceleration + 0.5 * offset_s**2 * jerk
    mean_position = mean(samples.position_rad - offset_s * samples.velocity_rad_s) + 0.5 * offset_s**2 * acceleration
    torque = samples.rows(starts).asked_nm(mean_position, mean_velocity)
    bad = gathered((touched | ~samples.is_off_the_stops).astype(np.float64)).any(axis=0)
    way = np.abs(np.sign(velocity).sum(axis=0)) == WIDTH
    fast = np.abs(velocity).min(axis=0) > MIN_SPEED_RAD_S
    steady = np.abs(acceleration) < np.minimum(np.abs(mean_velocity) / TURNING_TIME_S, STEADY_RAD_S2)
    calm = (np.abs(torque) < CALM_REQUEST_NM) & (np.abs(velocity).max(axis=0) < CALM_SPEED_RAD_S)
    bend = np.abs(np.diff(velocity, n=2, axis=0)).max(axis=0) if len(starts) else np.zeros_like(torque)
    weight = 1.0 / (1.0 + (bend * TYPICAL_INERTIA_KG_M2 / PERIOD_S / LOAD_DOUBT_NM) ** 2)
    return _Windows(
        run=samples.run[starts],
        excess_nm=torque - mean(samples.load_nm),
        velocity_rad_s=mean_velocity,
        acceleration_rad_s2=acceleration - 0.5 * offset_s * jerk,
        weight=np.where(~bad & way & fast & calm & steady, weight, 0.0),
    )


def _columns(space: SearchSpace, windows: _Windows) -> tuple[Array, tuple[int, ...]]:
    """Columns of searched friction (with its indices), then viscosity and inertia of hips and knees; (n, 12, c)."""
    velocity = windows.velocity_rad_s
    indices, columns = [], []
    for i, p in enumerate(space.parameters):
        effect = space.model.effects[p.effect_index]
        if isinstance(effect, CoulombFriction):
            indices.append(i)
            columns.append(np.sign(velocity) * effect.mask)
    knee = np.where(select_joints(("knees",)), 1.0, 0.0)
    columns += [velocity * (1.0 - knee), velocity * knee]
    columns += [windows.acceleration_rad_s2 * (1.0 - knee), windows.acceleration_rad_s2 * knee]
    return np.stack(columns, axis=-1), tuple(indices)


def _known_losses(space: SearchSpace, values: Array, windows: _Windows) -> Array:
    """Torque of the model's losses but for searched friction, shape (n, 12)."""
    searched = {p.effect_index for p in space.parameters}
    effects = enumerate(space.effects(values[None, :]))
    known = [e for i, e in effects if not (isinstance(e, CoulombFriction) and i in searched)]
    velocity = windows.velocity_rad_s
    return joint_losses_nm(known, LossMotion(velocity, windows.acceleration_rad_s2, np.sign(velocity)))
