"""Where the gap lies: signal × joint × regime against the real-versus-real floor, with run-level significance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from diagnosis.channels import Array, ChannelView, Flags, Ints
from diagnosis.channels.stack import Stack
from diagnosis.closed_loop.run_numbers import given_power_w, known_mean
from diagnosis.document import GapCell
from spot_log.format.events import FOLLOWING_MODE
from trainer.signals.smoothing import smooth

QUANTILES: Final = (np.arange(25) + 0.5) / 25
"""Quantiles of a run's digest in a cell; their mean difference is the Wasserstein distance."""
MIN_SAMPLES: Final = 40
N_PERMUTATIONS: Final = 400
N_BLOCK_DRAWS: Final = 200
NO_FLOOR: Final = (
    "no command sequence was run twice: what repeats explain is not known, and no p-value; intervals of the gap come "
    "from blocks of one second"
)
REVERSAL_S: Final = 0.02
"""Around a velocity reversal this long either way."""
UNITS: Final = {"position": "rad", "velocity": "rad/s", "load": "N·m", "load error": "N·m"}


@dataclass(frozen=True)
class GapSide:
    """Real or simulated logs, with the load's error against the servo law where channel *set-point to load* is on."""

    stack: Stack
    actuator: ChannelView | None


def gap_map(
    real: GapSide, simulated: GapSide, leg_of_joint: Ints, rng: np.random.Generator
) -> tuple[tuple[GapCell, ...], str]:
    """Compare real logs and the nominal model's runs of the same commands, cell by cell; and a note for the reader.

    ``leg_of_joint`` has shape (J,), -1 for none; ``rng`` draws the permutations.
    """
    joints = real.stack.recordings[0].joint_names
    sides = [(side, _signals(side), _regimes(real.stack, side.stack, leg_of_joint)) for side in (real, simulated)]
    names = [name for name in sides[0][2] if name in sides[1][2]]
    signals = [s for s in sides[0][1] if s in sides[1][1]]
    sequences = [r.sequence for side in (real, simulated) for r in side.stack.recordings]
    is_real = np.array([k == 0 for k, side in enumerate((real, simulated)) for _ in side.stack.recordings])
    digests, counts = zip(*(_digests(side.stack, v, flags, signals, names) for side, v, flags in sides), strict=True)
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
                    p_value=_known(p_values[index]),
                    low=_known(low[index]),
                    high=_known(high[index]),
                    unit=UNITS[signals[s]],
                    n_samples=int(total[j, r]),
                )
            )
    cells.sort(key=lambda c: -(c.ratio if c.ratio is not None else c.gap))
    return tuple(cells), "" if repeated else NO_FLOOR


def _known(value: Array) -> float | None:
    return float(value) if np.isfinite(value) else None


def _signals(side: GapSide) -> dict[str, Array]:
    stack = side.stack
    found = {"position": stack.states.position_rad, "velocity": stack.states.velocity_rad_s}
    if all(r.has("load_nm") for r in stack.recordings):
        found["load"] = stack.states.load_nm
    if side.actuator is not None:
        s: Any = side.actuator.signals
        found["load error"] = smooth(s.load_nm - s.torque_nm)
    return found


def _digests(
    stack: Stack, values: dict[str, Array], flags: dict[str, Flags], signals: Sequence[str], names: Sequence[str]
) -> tuple[Array, Ints]:
    n_joints = next(iter(values.values())).shape[1]
    out = np.full((len(stack.recordings), len(signals), n_joints, len(names), len(QUANTILES)), np.nan)
    counts = np.zeros((len(stack.recordings), n_joints, len(names)), dtype=np.intp)
    block = np.stack([values[s] for s in signals], axis=2)
    active, _ = _under_policy(stack)
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
    distance: Array, first: Ints, second: Ints, is_real: Flags, sequences: Sequence[str], rng: np.random.Generator
) -> Array:
    """Adjusted p-values of the cells: whole runs change sides within their sequence."""
    flat = distance.reshape(len(distance), -1)
    kept = np.isfinite(flat).all(axis=0)
    data = flat[:, kept]
    groups = [np.array([i for i, s in enumerate(sequences) if s == name]) for name in dict.fromkeys(sequences)]

    def statistic(labels: Flags) -> Array:
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
    real: GapSide,
    signals: Sequence[str],
    values_by_signal: dict[str, Array],
    model: Array,
    rng: np.random.Generator,
    names: Sequence[str],
) -> tuple[Array, Array]:
    """90 % interval of the gap over all joints and regimes, resampling blocks of one second of the real logs."""
    stack = real.stack
    values = np.stack([values_by_signal[s] for s in signals], axis=2)
    block = stack.run * 100_000 + stack.state // max(1, round(1.0 / stack.period_s))
    active, _ = _under_policy(stack)
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


def _regimes(real: Stack, stack: Stack, leg_of_joint: Ints) -> dict[str, Flags]:
    """Samples by regime, among them all, shape (n, J); thirds are those of the real logs, so that all are cut alike."""
    active, _ = _under_policy(real)
    used = real.used & active if (real.used & active).any() else np.ones(real.n, dtype=np.bool_)
    bounds = {name: np.quantile(values[used], (1 / 3, 2 / 3), axis=0) for name, values in _sizes(real).items()}
    thirds = {}
    for name, values in _sizes(stack).items():
        low, high = bounds[name]
        thirds[name] = {"low": values <= low, "middle": (values > low) & (values <= high), "high": values > high}
    load, velocity = stack.states.load_nm, stack.states.velocity_rad_s
    n_joints, driving = load.shape[1], load * velocity > 0.0
    found: dict[str, Flags] = {"all": np.ones(load.shape, dtype=np.bool_)}
    for word, flags in (("motoring", driving), ("braking", ~driving)):
        found[word] = flags
        found[f"{word}, high speed"] = flags & thirds["speed"]["high"]
        found[f"{word}, high torque"] = flags & thirds["torque"]["high"]
    for name in ("torque", "speed"):
        found |= {f"{word} {name}": flags for word, flags in thirds[name].items()}
    sign = np.sign(smooth(velocity))
    turned = np.diff(sign, axis=0, prepend=sign[:1]) != 0.0
    reach = max(1, round(REVERSAL_S / stack.period_s))
    found["velocity reversal"] = maximum_filter1d(turned.astype(np.int8), 2 * reach + 1, axis=0) > 0
    contact = stack.states.foot_contact
    if contact.shape[1] and leg_of_joint.max(initial=-1) >= 0:
        stance = contact[:, np.maximum(leg_of_joint, 0)] & (leg_of_joint >= 0)[None]
        found["stance"], found["swing"] = stance, ~stance
    for title, name, word in (
        ("low total power", "power", "low"),
        ("high total power", "power", "high"),
        ("first third of time", "time", "low"),
        ("last third of time", "time", "high"),
    ):
        found[title] = np.repeat(thirds[name][word], n_joints, axis=1)
    return found


def _sizes(stack: Stack) -> dict[str, Array]:
    """What has a low, a middle and a high third: of each joint, shape (n, J), or of the robot, shape (n, 1)."""
    load, velocity = stack.states.load_nm, stack.states.velocity_rad_s
    return {
        "torque": np.abs(load),
        "speed": np.abs(velocity),
        "power": given_power_w(load, velocity)[:, None],
        "time": _under_policy(stack)[1][:, None],
    }


def _under_policy(stack: Stack) -> tuple[Flags, Array]:
    """Rows between the first and the last tick in which the policy followed commands, and the time since that first, s.

    In a log whose ticks have no such mode, all rows from the first tick on.
    """
    flags, time_s = np.zeros(stack.n, dtype=np.bool_), np.zeros(stack.n)
    for number, recording in enumerate(stack.recordings):
        mine = np.flatnonzero(stack.run == number)
        ticks = recording.ticks
        rows = np.flatnonzero(ticks.mode == FOLLOWING_MODE) if len(ticks) else np.zeros(0, dtype=np.intp)
        stamps = ticks.robot_stamp_ns[rows] if len(rows) else ticks.robot_stamp_ns
        first = int(stamps[0]) if len(stamps) else recording.start_ns
        last = int(stamps[-1]) if len(rows) else int(recording.stamp_ns[-1])
        flags[mine] = (recording.stamp_ns >= first) & (recording.stamp_ns <= last)
        time_s[mine] = (recording.stamp_ns - first) * 1e-9
    return flags, time_s
