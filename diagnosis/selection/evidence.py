"""The evidence laid out for selection: where effects can act, and the channels as blocks.

A block is one scalar row of a channel, thinned, in units of its noise, with the ordinary errors beside it.
"""

from __future__ import annotations

import ctypes
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from diagnosis.channels import MAX_SAMPLES, Array, Channel, ChannelView, Flags, Ints, Shape, Views
from diagnosis.decision_constants import DEGREES_OF_FREEDOM, DISCREPANCY, FORMULA_ERROR, ErrorScale
from diagnosis.library import JointGroups, LibraryEffect, ThroughMotion, drive_of, with_stand_in
from diagnosis.selection.normal_equations import OrdinarySums
from diagnosis.selection.ordinary_errors import Ordinary, ordinary
from trainer.signals.smoothing import too_coarse

MIN_SAMPLES: Final = 30
COUNTED: Final = (Channel.TIME_STAMPS,)
FAR: Final = 20.0
"""In channels of stamps, what is farther off than this many usual sizes is a hand-over, not a delay."""
OUTLIER: Final = 3.0
"""A response counts as no more than so many of its row's scales, by its median size: late flags, impacts, slips."""
PEAKS: Final = (Channel.SET_POINT_TO_LOAD, Channel.POLICY_REPLAY, Channel.BATTERY_POWER)
PEAK: Final = 6.0
"""Where peaks are what an effect cuts off, they count up to so many scales."""
FOLD_BLOCK_S: Final = 2.0
EXACT: Final = {Channel.POLICY_REPLAY: 0.02}
"""Channels whose formulas are no physics: a program's arithmetic is right or wrong."""
NOISY_COLUMNS: Final = frozenset({Channel.SET_POINT_TO_LOAD, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH})
"""Channels whose columns are made of measured loads and accelerations, as the response is."""
LEAST: Final = 0.05
"""Least square of a tolerance: noise is not known better."""


@dataclass(frozen=True)
class Block:
    """One row of one channel."""

    channel: Channel
    row: int
    samples: Ints
    """Samples of the view, shape (m,)."""
    y: Array
    """Response in units of the noise, without what the nuisance columns explain. Shape (m,)."""
    nuisance: Array
    """Orthonormal, shape (m, q)."""
    fold: Ints
    """Shape (m,)."""
    rows_of_fold: tuple[Ints, ...]
    noise: float
    n_independent: float
    """Number of independent samples, from the response's correlation in time."""
    tolerance: float
    """Standard deviation, in units of the noise, that a nominal model of ordinary quality leaves unexplained."""
    weight: Array
    """Square root of what a sample counts, less than 1 for outliers. Shape (m,)."""

    def cleaned(self, raw: Array) -> Array:
        """Columns at the block's samples as the block has them, in units of its noise, nuisance taken off."""
        x = np.nan_to_num(raw) / self.noise
        flat = x.reshape(len(x), -1)
        return np.asarray(flat - self.nuisance @ (self.nuisance.T @ flat)).reshape(x.shape)


@dataclass(frozen=True)
class Columns:
    """What an effect of one shape adds to each block it touches."""

    units: list[Ints]
    """By block: units that touch it, shape (u,); empty where none does."""
    x: list[Array]
    """By block, shape (m, u, P), in units of the noise, nuisance removed."""

    def flat(self) -> list[Array]:
        """By block, shape (m, uP)."""
        return [x.reshape(len(x), -1) for x in self.x]


def key_of(effect: LibraryEffect, shape: Shape) -> tuple[object, ...]:
    """What columns and their products are kept under."""
    return (effect.name, *sorted(shape.items()))


@dataclass
class Evidence:
    """All blocks of a set of logs."""

    views: Views
    robot: JointGroups
    blocks: tuple[Block, ...]
    n_folds: int
    fold_names: tuple[str, ...]
    dof: Array
    """Independent ways in which a formula can be off, by block; at most the number of independent samples."""
    tolerance_square: Array
    """By block."""
    relative_square: Array
    """By block: mean square that a formula leaves of what it explains."""
    least: Array
    """By block: the least mean square that counts. Where noise is in the columns, too, a scale that shrinks both sides
    of an equation would seem to explain it."""
    period_s: float
    """Between two states."""
    ordinary: Ordinary = field(init=False)
    sums: OrdinarySums = field(init=False)
    """What is the same whatever is tried: products of [ordinary errors, y], over each block's number of samples."""
    kept: dict[object, Any] = field(default_factory=dict)
    """What scoring keeps between calls."""
    _beside: list[Array] = field(default_factory=list)
    """By block [ordinary errors, y]."""
    _cache: OrderedDict[tuple[object, ...], Columns] = field(default_factory=OrderedDict)
    _bytes: int = 0

    @property
    def stretch(self) -> int:
        """States in :data:`FOLD_BLOCK_S`: pieces that time is cut into where there are few runs."""
        return stretch_of(self.period_s)

    @property
    def is_coarse(self) -> bool:
        """Whether states are so far apart that quick effects do not show, nor what else would be left of them."""
        return bool(too_coarse(self.period_s))

    def sees(self, effect: LibraryEffect) -> bool:
        """Whether an effect can be seen in these logs."""
        return bool(effect.show(self.views)) and not (effect.is_quick and self.is_coarse)

    def prepare(self, library: Mapping[str, LibraryEffect], scales: Mapping[str, ErrorScale]) -> None:
        """Lay the ordinary errors out; once, before anything is scored."""
        made = ordinary(self, library, scales)
        self._beside = [
            np.concatenate([z, block.y[:, None]], axis=1) for z, block in zip(made.x, self.blocks, strict=True)
        ]
        # The same numbers, kept once.
        self.ordinary = replace(made, x=tuple(both[:, :-1] for both in self._beside))
        base = [
            np.array([self.products_of(number, both, both, fold) for fold in range(self.n_folds)])
            for number, both in enumerate(self._beside)
        ]
        self.sums = OrdinarySums(made.numbers, made.size, base)

    def shapes(self, effect: LibraryEffect) -> tuple[Shape, ...]:
        """Coarse shapes of an effect that these logs let one try; none where it shows nowhere."""
        key = ("shapes", effect.name)
        if key not in self.kept:
            everywhere = np.ones(self.robot.n_joints, dtype=np.bool_)
            try:
                self.kept[key] = tuple(effect.shapes(self.views, everywhere))
            except (KeyError, ValueError):
                self.kept[key] = ()
        found: tuple[Shape, ...] = self.kept[key]
        return found

    def products_of(self, number: int, left: Array, right: Array, fold: int | None = None) -> Array:
        """Products of two sets of a block's columns over all folds or in one, by its number of samples; (a, b)."""
        if not left.any():
            return np.zeros((left.shape[1], right.shape[1]))
        block = self.blocks[number]
        weight = block.weight**2
        if fold is not None:
            rows = block.rows_of_fold[fold]
            left, right, weight = left[rows], right[rows], weight[rows]
        return np.asarray((left * weight[:, None]).T @ right, dtype=np.float64) / len(block.y)

    def products(self, number: int, x: Array, fold: int | None = None) -> Array:
        """Products of a block's columns with [ordinary errors, y], shape (a, q + 1)."""
        return self.products_of(number, x, self._beside[number], fold)

    @property
    def by_channel(self) -> dict[Channel, list[int]]:
        """Numbers of the blocks of each channel."""
        found: dict[Channel, list[int]] = {}
        for number, block in enumerate(self.blocks):
            found.setdefault(block.channel, []).append(number)
        return found

    def columns(self, effect: LibraryEffect, shape: Shape) -> Columns:
        """Columns of every unit of the effect; cached."""
        key = key_of(effect, shape)
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        made = self._made(effect, shape)
        self._cache[key] = made
        self._bytes += sum(x.nbytes for x in made.x)
        while self._bytes > 200_000_000 and len(self._cache) > 1:
            _, old = self._cache.popitem(last=False)
            self._bytes -= sum(x.nbytes for x in old.x)
        return made

    def forget(self) -> None:
        """Free the columns of all that was tried, here and in the channels; what is asked for again is made again."""
        self._cache.clear()
        self._bytes = 0
        for view in self.views.values():
            getattr(view.signals, "cache", {}).clear()
        getattr(ctypes.CDLL(None), "malloc_trim", int)(0)  # glibc keeps what is freed between what is not

    def _made(self, effect: LibraryEffect, shape: Shape) -> Columns:
        units = self.robot.units(effect.location)
        every = np.ones(self.robot.n_joints, dtype=np.bool_)
        made = Columns(
            [np.zeros(0, dtype=np.intp)] * len(self.blocks),
            [np.zeros((len(b.y), 0, len(effect.coefficients))) for b in self.blocks],
        )
        for channel, numbers in self.by_channel.items():
            view = self.views[channel]
            seen = _seen(effect, shape, view)
            if seen is None:
                continue
            at_once = channel in effect.separable or len(units) == 1
            parts = [seen(every)] if at_once else [seen(unit > 0.5) for unit in units]
            for number in numbers:
                block = self.blocks[number]
                touching = np.arange(len(parts))
                if at_once and len(units) > 1:
                    joint = int(view.row_joint[block.row])
                    touching = np.array([np.argmax(units[:, joint])] if joint >= 0 else [], dtype=np.intp)
                if len(touching):
                    x = block.cleaned(np.stack([p[block.samples, block.row] for p in parts], axis=1))
                    there = np.flatnonzero(np.abs(x).max(axis=(0, 2), initial=0.0) > 0.0)
                    made.units[number], made.x[number] = touching[there], x[:, there].astype(np.float32)
        return made


def _seen(effect: LibraryEffect, shape: Shape, view: ChannelView) -> Callable[[Flags], Array] | None:
    """An effect's columns at some joints: its own in the channel, and what it changes in a drive without loads."""
    own = view.name in effect.channels
    if Channel.SET_POINT_TO_LOAD not in effect.channels or drive_of(view) is None:
        return (lambda joints: effect.columns(view, shape, joints)) if own else None
    through = ThroughMotion(effect, shape, view)
    if not own:
        return through.columns
    return lambda joints: through.columns(joints) + effect.columns(view, shape, joints)


def stretch_of(period_s: float) -> int:
    """States in :data:`FOLD_BLOCK_S`."""
    return max(1, round(FOLD_BLOCK_S / period_s))


def lay_out(
    views: Views,
    robot: JointGroups,
    fold_of_run: Sequence[int],
    fold_names: Sequence[str],
    *,
    library: Mapping[str, LibraryEffect],
    scales: Mapping[str, ErrorScale],
    period_s: float = 0.003,
) -> Evidence:
    """Cut the channels into blocks, with the ordinary errors of ``scales`` by effects of the library beside them.

    ``fold_of_run`` has the fold of each recording; with one fold only, time is cut into two.
    """
    stretch = stretch_of(period_s)
    by_run = np.asarray(fold_of_run) if len(fold_names) > 1 else None
    blocks = [
        block
        for view in views.values()
        if view.is_measured
        for row in range(len(view.rows))
        if (block := _block(view, row, by_run, max(2, len(fold_names)), stretch)) is not None
    ]
    board = Evidence(
        with_stand_in(views),
        robot,
        tuple(blocks),
        max(2, len(fold_names)),
        tuple(fold_names),
        dof=np.minimum(DEGREES_OF_FREEDOM, [b.n_independent for b in blocks]),
        tolerance_square=np.array([b.tolerance**2 for b in blocks]) + LEAST,
        relative_square=np.array([EXACT.get(b.channel, FORMULA_ERROR) ** 2 for b in blocks]),
        least=np.array([float(b.channel in NOISY_COLUMNS) for b in blocks]),
        period_s=period_s,
    )
    board.prepare(library, scales)
    return board


def _block(view: ChannelView, row: int, fold_of_run: Ints | None, n_folds: int, stretch: int) -> Block | None:
    good: Flags = view.usable[:, row] & np.isfinite(view.response[:, row])
    good &= np.isfinite(view.nuisance[:, row]).all(axis=1)
    noise, step = float(view.noise[row]), max(1, round(view.n / MAX_SAMPLES))
    if view.name in COUNTED:
        size = np.abs(view.response[:, row])
        good &= size <= FAR * ((float(np.median(size[good])) if good.any() else 0.0) + noise)
    samples = np.flatnonzero(good)
    samples = samples[::step] if len(samples) > MIN_SAMPLES * step else samples
    if len(samples) < MIN_SAMPLES // 3 or not np.isfinite(noise) or noise <= 0.0:
        return None
    y = view.response[samples, row] / noise
    q = np.zeros((len(samples), 0))
    if view.nuisance.shape[2]:
        raw = view.nuisance[samples, row]
        q, _ = np.linalg.qr(raw / (np.sqrt(np.mean(raw**2, axis=0)) + 1e-12))
        y = y - q @ (q.T @ y)
    run = view.run[samples]
    fold = fold_of_run[run] if fold_of_run is not None else (view.state[samples] // stretch) % 2
    return Block(
        view.name,
        row,
        samples,
        y,
        q,
        fold,
        tuple(np.flatnonzero(fold == f) for f in range(n_folds)),
        noise,
        _independent(y, run),
        DISCREPANCY.get(view.name, 0.0),
        _weight(view, y),
    )


def _weight(view: ChannelView, y: Array) -> Array:
    """Square root of what a sample counts, shape (m,)."""
    if not view.is_robust:
        return np.ones(len(y))
    scale = max(1.0, 1.4826 * float(np.median(np.abs(y))))
    bound = (PEAK if view.name in PEAKS else OUTLIER) * scale
    # The square of what is farther off counts as the bound's.
    return np.asarray(np.minimum(1.0, bound / np.maximum(np.abs(y), 1e-12)))


def _independent(y: Array, run: Ints) -> float:
    """Number of independent samples by the integrated correlation within runs, about the mean."""
    y = y - np.mean(y)
    spread = float(np.mean(y**2))
    if spread <= 0.0:
        return float(len(y))
    total = 1.0
    for lag in range(1, min(60, len(y) // 4)):
        same = run[lag:] == run[:-lag]
        if not same.any():
            break
        share = float(np.mean((y[lag:] * y[:-lag])[same])) / spread
        if share < 0.05:
            break
        total += 2.0 * share
    return len(y) / total
