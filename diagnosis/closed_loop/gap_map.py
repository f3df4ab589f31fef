"""Where the gap lies: signal × joint × regime against the real-versus-real floor, with run-level significance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels.channel_view import Array, ChannelView, Ints
from diagnosis.channels.stack import Stack
from diagnosis.closed_loop.regimes import regimes, under_policy
from diagnosis.closed_loop.run_numbers import known_mean
from diagnosis.document import GapCell

QUANTILES: Final = (np.arange(25) + 0.5) / 25
"""Of which a run's digest in a cell is made; their mean difference is the Wasserstein distance."""
MIN_SAMPLES: Final = 40
N_PERMUTATIONS: Final = 400
BLOCK_S: Final = 1.0
N_BLOCK_DRAWS: Final = 200
NO_FLOOR: Final = (
    "no command sequence was run twice: there is no real-versus-real floor and no p-value; intervals of the gap come "
    "from blocks of one second"
)
UNITS: Final = {"position": "rad", "velocity": "rad/s", "load": "N·m", "load error": "N·m"}


@dataclass(frozen=True)
class GapMap:
    """All cells."""

    cells: tuple[GapCell, ...]
    has_floor: bool
    note: str


@dataclass(frozen=True)
class Side:
    """Real or simulated logs, with the load's error against the servo law where channel *set-point to load* is on."""

    stack: Stack
    actuator: ChannelView | None


def gap_map(real: Side, simulated: Side, leg_of_joint: Ints, rng: np.random.Generator) -> GapMap:
    """Compare real logs and the nominal model's runs of the same commands, cell by cell.

    ``leg_of_joint`` has shape (J,), -1 for none; ``rng`` draws the permutations.
    """
    joints = real.stack.recordings[0].joint_names
    sides = [(side, _signals(side), regimes(real.stack, side.stack, leg_of_joint)) for side in (real, simulated)]
    names = [name for name in sides[0][2] if name in sides[1][2]]
    signals = [s for s in sides[0][1] if s in sides[1][1]]
    sequences = [r.sequence for side in (real, simulated) for r in side.stack.recordings]
    is_real = np.array([k == 0 for k, side in enumerate((real, simulated)) for _ in side.stack.recordings])
    digests, counts = [], []
    for side, values, flags in sides:
        d, c = _digests(side.stack, values, flags, signals, names)
        digests.append(d)
        counts.append(c)
    digest = np.concatenate(digests)  # (runs, signals, joints, regimes, quantiles)
    pairs = [(i, j) for i in range(len(digest)) for j in range(i) if sequences[i] == sequences[j]]
    distance = np.array([np.abs(digest[i] - digest[j]).mean(axis=-1) for i, j in pairs])
    first, second = (np.array(p) for p in zip(*pairs, strict=True))
    repeated = any(sum(s == name and r for s, r in zip(sequences, is_real, strict=True)) > 1 for name in set(sequences))
    gap = known_mean(distance[is_real[first] != is_real[second]])
    floor = known_mean(distance[is_real[first] & is_real[second]]) if repeated else np.full(gap.shape, np.nan)
    p_values = _p_values(distance, first, second, is_real, sequences, rng) if repeated else np.full(gap.shape, np.nan)
    total = counts[0].sum(axis=0)
    low, high = (np.full(gap.shape, np.nan),) * 2
    if not repeated:
        low, high = _block_interval(real, signals, sides[0][1], digests[1], rng, names)
    cells = []
    for index in np.ndindex(gap.shape):
        s, j, r = index
        if np.isfinite(gap[index]) and (not repeated or np.isfinite(floor[index])):
            f = float(floor[index]) if repeated else 0.0
            cells.append(
                GapCell(
                    signal=signals[s],
                    joint=joints[j],
                    regime=names[r],
                    gap=float(gap[index]),
                    floor=f,
                    ratio=float(gap[index]) / f if repeated and f > 0.0 else None,
                    p_value=float(p_values[index]) if repeated and np.isfinite(p_values[index]) else None,
                    low=float(low[index]) if np.isfinite(low[index]) else None,
                    high=float(high[index]) if np.isfinite(high[index]) else None,
                    unit=UNITS[signals[s]],
                    n_samples=int(total[j, r]),
                )
            )
    cells.sort(key=lambda c: -(c.ratio if c.ratio is not None else c.gap))
    return GapMap(tuple(cells), repeated, "" if repeated else NO_FLOOR)


def _signals(side: Side) -> dict[str, Array]:
    stack = side.stack
    found = {"position": stack.filled(lambda r: r.position_rad), "velocity": stack.filled(lambda r: r.velocity_rad_s)}
    if all(r.has("load_nm") for r in stack.recordings):
        found["load"] = stack.filled(lambda r: r.load_nm)
    if side.actuator is not None:
        s: Any = side.actuator.signals
        found["load error"] = stack.smooth(s.load_nm - s.torque_nm)
    return found


def _digests(
    stack: Stack,
    values: dict[str, Array],
    flags: dict[str, NDArray[np.bool_]],
    signals: Sequence[str],
    names: Sequence[str],
) -> tuple[Array, Ints]:
    n_joints = next(iter(values.values())).shape[1]
    out = np.full((len(stack.recordings), len(signals), n_joints, len(names), len(QUANTILES)), np.nan)
    counts = np.zeros((len(stack.recordings), n_joints, len(names)), dtype=np.intp)
    block = np.stack([values[s] for s in signals], axis=2)
    active, _ = under_policy(stack)
    for run in range(len(stack.recordings)):
        mine = np.flatnonzero((stack.run == run) & stack.used & active)[::2]
        part = block[mine]
        for r, name in enumerate(names):
            chosen = flags[name][mine]
            for joint in range(n_joints):
                x = part[chosen[:, joint], joint]
                counts[run, joint, r] = len(x)
                if len(x) >= MIN_SAMPLES:
                    ordered = np.sort(x, axis=0)
                    out[run, :, joint, r] = ordered[(QUANTILES * len(x)).astype(np.intp)].T
    return out, counts


def _p_values(
    distance: Array,
    first: Ints,
    second: Ints,
    is_real: NDArray[np.bool_],
    sequences: Sequence[str],
    rng: np.random.Generator,
) -> Array:
    """Adjusted p-values of the cells: whole runs change sides within their sequence."""
    flat = distance.reshape(len(distance), -1)
    kept = np.isfinite(flat).all(axis=0)
    data = flat[:, kept]
    groups = [np.array([i for i, s in enumerate(sequences) if s == name]) for name in dict.fromkeys(sequences)]

    def statistic(labels: NDArray[np.bool_]) -> Array:
        cross = labels[first] != labels[second]
        return np.asarray(data[cross].mean(axis=0) - data[~cross].mean(axis=0))

    observed = statistic(is_real)
    exceeded = np.ones(data.shape[1])
    for _ in range(N_PERMUTATIONS):
        labels = is_real.copy()
        for group in groups:
            labels[group] = labels[rng.permutation(group)]
        exceeded += statistic(labels) >= observed - 1e-12
    out = np.full(flat.shape[1], np.nan)
    out[kept] = benjamini_hochberg(exceeded / (N_PERMUTATIONS + 1))
    return out.reshape(distance.shape[1:])


def benjamini_hochberg(p_values: Array) -> Array:
    """Adjusted p-values, same order, shape (m,): the smallest false-discovery rate at which each is a discovery."""
    m = len(p_values)
    order = np.argsort(p_values)
    scaled = p_values[order] * m / np.arange(1, m + 1)
    adjusted = np.minimum(1.0, np.minimum.accumulate(scaled[::-1])[::-1])
    out = np.empty(m)
    out[order] = adjusted
    return out


def _block_interval(
    real: Side,
    signals: Sequence[str],
    values_by_signal: dict[str, Array],
    model: Array,
    rng: np.random.Generator,
    names: Sequence[str],
) -> tuple[Array, Array]:
    """90 % interval of the gap over all joints and regimes, resampling blocks of one second of the real logs."""
    stack = real.stack
    values = np.stack([values_by_signal[s] for s in signals], axis=2)
    block = stack.run * 100_000 + stack.state // max(1, round(BLOCK_S / stack.period_s))
    active, _ = under_policy(stack)
    kinds, number = np.unique(np.where(stack.used & active, block, -1), return_inverse=True)
    rows_of = [np.flatnonzero(number == k)[::4] for k in range(len(kinds)) if kinds[k] >= 0]
    reference = known_mean(model)
    shape = reference.shape[:-1]
    draws = np.full((N_BLOCK_DRAWS, *shape), np.nan)
    at = names.index("all")
    for draw in range(N_BLOCK_DRAWS):
        rows = np.concatenate([rows_of[k] for k in rng.integers(len(rows_of), size=len(rows_of))])
        ordered = np.sort(values[rows], axis=0)[(QUANTILES * len(rows)).astype(np.intp)]  # (Q, J, S)
        draws[draw, :, :, at] = np.abs(np.moveaxis(ordered, (0, 1, 2), (2, 1, 0)) - reference[:, :, at]).mean(axis=-1)
    with np.errstate(all="ignore"):
        return np.quantile(draws, 0.05, axis=0), np.quantile(draws, 0.95, axis=0)
