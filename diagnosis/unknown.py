"""What no effect explains: how much of it is predictable, at which joints, in which regime, on which quantities."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor

from diagnosis.channels.actuator import STRIDE
from diagnosis.seam import Array, ChannelView, Flags, Ints
from diagnosis.selection.board import Board
from diagnosis.verdict import Dependence, UnknownEffect

MAX_TREES: Final = 40
MAX_ROWS: Final = 3000
N_CURVE: Final = 12
MIN_SHARE: Final = 0.05
HEAT_S: Final = 30.0


@dataclass(frozen=True)
class Remainder:
    """What is left of channel A, and how much of it signals predict."""

    shares: Array
    """By joint: share of the residual's variance that is predictable in folds that the fit never saw. Shape (J,)."""
    sizes: Array
    """By joint: root mean square of the residual, N·m. Shape (J,)."""
    predictable_nm: Array
    """By joint: root mean square of the predictable part, N·m. Shape (J,)."""
    importance: Array
    """By quantity, over the joints with the largest predictable part; sum 1. Shape (Q,)."""
    names: tuple[str, ...]

    @property
    def share(self) -> float:
        """Share over the three joints with the largest predictable part."""
        top = np.argsort(-self.predictable_nm)[:3]
        total = float(np.sum(self.sizes[top] ** 2))
        return float(np.sum(self.predictable_nm[top] ** 2)) / total if total > 0.0 else 0.0


def quantities(view: ChannelView) -> tuple[tuple[str, ...], Array]:
    """What a residual may depend on, shape (n, J, Q)."""
    s: Any = view.signals

    def thin(values: Array) -> Array:
        return values[::STRIDE]

    n_joints = s.torque_nm.shape[1]

    def shared(values: Array) -> Array:
        return np.repeat(thin(values)[:, None], n_joints, axis=1)

    power = np.maximum(s.torque_nm * s.velocity_rad_s, 0.0).sum(axis=1)
    table = {
        "position": thin(s.position_rad),
        "velocity": s.finish(s.velocity_rad_s),
        "torque": s.finish(s.torque_nm),
        "acceleration": s.finish_rate(s.velocity_rad_s),
        "torque rate": s.finish_rate(s.torque_nm),
        "total power": shared(power),
        "time since start": shared(s.stack.state * s.stack.period_s),
        "torque history": thin(s.integrated(s.load_nm**2, HEAT_S)),
        "time since set-point": shared(np.minimum(s.command_age_s, 0.1)),
    }
    return tuple(table), np.stack(list(table.values()), axis=2)


def remainder(board: Board, residuals: list[Array]) -> Remainder | None:
    """Predict what is left of channel A from signals, joint by joint; None where the channel is off."""
    numbers = board.by_channel.get("A", [])
    if not numbers:
        return None
    names, table = quantities(board.views["A"])
    n_joints = board.robot.n_joints
    shares, sizes, parts = np.zeros(n_joints), np.zeros(n_joints), np.zeros(n_joints)
    importance = np.zeros((n_joints, len(names)))
    for number in numbers:
        block = board.blocks[number]
        step = max(1, len(block.y) // MAX_ROWS)
        y = (residuals[number] * block.noise)[::step]
        y = np.clip(y, *np.percentile(y, [0.5, 99.5]))
        x = table[block.samples, block.row][::step]
        share, weight = _predictable(x, y, block.fold[::step])
        sizes[block.row] = float(np.sqrt(np.mean(y**2)))
        shares[block.row] = share
        parts[block.row] = sizes[block.row] * np.sqrt(share)
        importance[block.row] = weight * parts[block.row] ** 2
    total = importance.sum(axis=0)
    return Remainder(shares, sizes, parts, total / max(float(total.sum()), 1e-12), names)


def _predictable(x: Array, y: Array, fold: Ints) -> tuple[float, Array]:
    """Held-out share of variance that trees predict, and the permutation importance of each quantity."""
    rng = np.random.default_rng(0)
    left, total, drops = 0.0, 0.0, np.zeros(x.shape[1])
    for f in np.unique(fold):
        test = fold == f
        if test.all() or test.sum() < 20:
            continue
        trees = HistGradientBoostingRegressor(
            max_iter=MAX_TREES, max_leaf_nodes=12, min_samples_leaf=30, random_state=0
        )
        trees.fit(x[~test], y[~test])
        error = float(np.sum((y[test] - trees.predict(x[test])) ** 2))
        left, total = left + error, total + float(np.sum(y[test] ** 2))
        if error < 0.98 * float(np.sum(y[test] ** 2)):
            for q in range(x.shape[1]):
                mixed = x[test].copy()
                mixed[:, q] = rng.permutation(mixed[:, q])
                drops[q] += max(0.0, float(np.sum((y[test] - trees.predict(mixed)) ** 2)) - error)
    share = max(0.0, 1.0 - left / total) if total > 0.0 else 0.0
    return share, drops / max(float(drops.sum()), 1e-12)


def describe(board: Board, residuals: list[Array], found: Remainder) -> UnknownEffect:
    """Joints, regime, the two quantities it depends on most, and the fitted curves."""
    top = float(found.predictable_nm.max(initial=0.0))
    joints = np.flatnonzero(found.predictable_nm > 0.5 * top) if top > 0.0 else np.zeros(0, dtype=np.intp)
    order = np.argsort(-found.importance)[:2]
    names, table = quantities(board.views["A"])
    x, y, motoring = [], [], []
    for number in board.by_channel["A"]:
        block = board.blocks[number]
        if block.row in joints:
            part = table[block.samples, block.row]
            x.append(part)
            y.append(residuals[number] * block.noise)
            motoring.append(part[:, names.index("torque")] * part[:, names.index("velocity")] > 0.0)
    if not x:
        return UnknownEffect(joints=(), regime="", depends_on=())
    values, left, drive = np.concatenate(x), np.concatenate(y), np.concatenate(motoring)
    curves = tuple(_curve(names[q], float(found.importance[q]), values[:, q], left) for q in order)
    fast = np.abs(values[:, names.index("velocity")])
    heavy = np.abs(values[:, names.index("torque")])
    return UnknownEffect(
        joints=board.robot.named(np.isin(np.arange(board.robot.n_joints), joints)),
        regime=_regime(left, drive, fast, heavy),
        depends_on=tuple(names[q] for q in order),
        channel="A",
        unit="N·m",
        predictable_share=found.share,
        curves=curves,
    )


def _regime(left: Array, drive: Flags, speed: Array, torque: Array) -> str:
    """The part of motion in which the residual is largest."""
    options = {
        "motoring": drive, "braking": ~drive, "low speed": speed < np.quantile(speed, 1 / 3),
        "high speed": speed > np.quantile(speed, 2 / 3), "low torque": torque < np.quantile(torque, 1 / 3),
        "high torque": torque > np.quantile(torque, 2 / 3),
    }  # fmt: skip
    sizes = {name: float(np.mean(left[rows] ** 2)) for name, rows in options.items() if rows.any()}
    return max(sizes, key=lambda name: sizes[name]) if sizes else ""


def _curve(name: str, importance: float, x: Array, y: Array) -> Dependence:
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, N_CURVE + 1)))
    at, mean = [], []
    for low, high in pairwise(edges):
        rows = (x >= low) & (x <= high)
        if rows.any():
            at.append(float(np.mean(x[rows])))
            mean.append(float(np.mean(y[rows])))
    return Dependence(quantity=name, importance=importance, at=tuple(at), residual=tuple(mean))
