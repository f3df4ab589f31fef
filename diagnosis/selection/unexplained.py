"""What no effect explains: how much of it is predictable, where, in which regime, on which quantities."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.channels.stack import Stack
from diagnosis.document import Dependence, UnknownEffect
from diagnosis.selection.evidence import EXACT, Evidence
from diagnosis.selection.formula import find_formula
from spot_model.robot.rotation import projected_gravity
from trainer.signals.recording import Recording
from trainer.signals.smoothing import smooth

MAX_TREES: Final = 40
MAX_ROWS: Final = 3000
N_CURVE: Final = 12
MIN_NATS: Final = 1.0
"""A signal of which less than this could be gained is not looked at."""
CARRIES: Final = 0.25
"""A joint with this share of the most at one joint carries the unknown effect, too."""


@dataclass(frozen=True)
class Remainder:
    """What is left in each block, and how much of it signals predict."""

    channels: tuple[Channel, ...]
    """By block."""
    nats: Array
    """By block: what explaining the predictable part would bring. Shape (B,)."""
    shares: Array
    """By block: share of the residual's square that is predictable in folds that the fit never saw. Shape (B,)."""
    left: Array
    """By block: mean square of the residual, units of the noise. Shape (B,)."""
    importance: tuple[Array, ...]
    """By block: of each quantity; sum 1, or all 0."""

    def beyond(self, usual_nats: Mapping[str, float]) -> float:
        """Over all channels, what is more than usual for the channel with nothing amiss."""
        found: dict[str, float] = {}
        for channel, nats in zip(self.channels, self.nats, strict=True):
            found[channel] = found.get(channel, 0.0) + float(nats)
        return sum(max(0.0, nats - usual_nats.get(channel, 0.0)) for channel, nats in found.items())


def remainder(board: Evidence, stack: Stack, residuals: Sequence[Array], explained: Array) -> Remainder:
    """Predict what is left from signals, block by block.

    Residuals by block, in units of the noise; ``explained`` is by block the mean square of what the chosen effects
    explain, of which a formula leaves a share.
    """
    quantities = Quantities(stack)
    n = len(board.blocks)
    nats, shares, left = np.zeros(n), np.zeros(n), np.zeros(n)
    importance = [np.zeros(0)] * n
    tolerance = board.tolerance_square + board.relative_square * explained
    for number, block in enumerate(board.blocks):
        y = residuals[number] * block.weight
        left[number] = float(np.mean(y**2))
        # Noise alone is 1; what could be gained if all the rest were explained.
        could = 0.5 * board.dof[number] * np.log((left[number] + tolerance[number]) / (1.0 + tolerance[number]))
        if left[number] <= 1.0 or could < MIN_NATS:
            continue
        step = max(1, len(y) // MAX_ROWS)
        _, x = quantities.of(board.views[block.channel], block.row, block.samples[::step])
        share, importance[number] = _predictable(x, y[::step], block.fold[::step])
        if block.channel in EXACT:
            share = 1.0
        shares[number] = share
        rest = max(left[number] * (1.0 - share), min(1.0, left[number]))
        nats[number] = 0.5 * board.dof[number] * np.log((left[number] + tolerance[number]) / (rest + tolerance[number]))
    return Remainder(tuple(b.channel for b in board.blocks), nats, shares, left, tuple(importance))


def _predictable(x: Array, y: Array, fold: Ints) -> tuple[float, Array]:
    """Held-out share of the square that trees, or the mean alone, predict; and each quantity's importance."""
    rng = np.random.default_rng(0)
    left, total, drops = 0.0, 0.0, np.zeros(x.shape[1])
    for f in np.unique(fold):
        test = fold == f
        if test.all() or test.sum() < 5:
            continue
        here = float(np.sum(y[test] ** 2))
        if x.shape[1] == 0 or (~test).sum() < 100:
            left, total = left + float(np.sum((y[test] - np.mean(y[~test])) ** 2)), total + here
            continue
        trees = HistGradientBoostingRegressor(
            max_iter=MAX_TREES, max_leaf_nodes=12, min_samples_leaf=30, random_state=0
        )
        trees.fit(x[~test], y[~test])
        error = float(np.sum((y[test] - trees.predict(x[test])) ** 2))
        left, total = left + error, total + here
        if error < 0.95 * here:
            for q in range(x.shape[1]):
                mixed = x[test].copy()
                mixed[:, q] = rng.permutation(mixed[:, q])
                drops[q] += max(0.0, float(np.sum((y[test] - trees.predict(mixed)) ** 2)) - error)
    share = max(0.0, 1.0 - left / total) if total > 0.0 else 0.0
    return share, drops / max(float(drops.sum()), 1e-12)


def nats_by_joint(board: Evidence, found: Remainder) -> Array:
    """Share of each joint in what is left and predictable; a leg's rows count for its joints. Shape (J,)."""
    out = np.zeros(board.robot.n_joints)
    for number, block in enumerate(board.blocks):
        view = board.views[block.channel]
        joint, leg = int(view.row_joint[block.row]), int(view.row_leg[block.row])
        if joint >= 0:
            out[joint] += found.nats[number]
        elif leg >= 0:
            mine = view.leg_of_joint == leg
            out[mine] += found.nats[number] / max(1, int(mine.sum()))
    return out


def describe(board: Evidence, stack: Stack, residuals: Sequence[Array], found: Remainder) -> UnknownEffect:
    """Joints, regime, the two quantities it depends on most, and the fitted curves, in the channel that has most."""
    by_joint = nats_by_joint(board, found)
    joints = by_joint > CARRIES * max(float(by_joint.max(initial=0.0)), 1e-9)
    by_channel = {c: float(found.nats[numbers].sum()) for c, numbers in board.by_channel.items()}
    channel = max(by_channel, key=lambda c: by_channel[c])
    numbers = [
        n for n in board.by_channel[channel] if found.nats[n] > CARRIES * found.nats[board.by_channel[channel]].max()
    ]
    if not numbers or by_channel[channel] <= 0.0:
        return UnknownEffect(joints=board.robot.named(joints), regime="", depends_on=())
    view = board.views[channel]
    quantities = Quantities(stack)
    weight: dict[str, float] = {}
    x: dict[str, list[Array]] = {}
    left: list[Array] = []
    for n in numbers:
        block = board.blocks[n]
        names, table = quantities.of(view, block.row, block.samples)
        left.append(residuals[n] * block.noise)
        for i, name in enumerate(names):
            importance = found.importance[n]
            weight[name] = weight.get(name, 0.0) + float(found.nats[n] * (importance[i] if len(importance) else 0.0))
            x.setdefault(name, []).append(table[:, i])
    common = [name for name in sorted(weight, key=lambda k: -weight[k]) if len(x[name]) == len(numbers)]
    total = max(sum(weight.values()), 1e-12)
    y = np.concatenate(left)
    curves = tuple(_curve(name, weight[name] / total, np.concatenate(x[name]), y) for name in common[:2])
    share = float(np.average(found.shares[numbers], weights=found.left[numbers]))
    return UnknownEffect(
        joints=board.robot.named(joints),
        regime=_regime({name: np.concatenate(x[name]) for name in common}, y),
        depends_on=tuple(common[:2]),
        channel=channel,
        unit=view.unit,
        predictable_share=share,
        curves=curves,
        formula=find_formula(board, residuals, joints),
    )


def _regime(x: dict[str, Array], left: Array) -> str:
    """The part of motion in which the residual is largest."""
    options: dict[str, Flags] = {}
    if "torque" in x and "velocity" in x:
        drive = x["torque"] * x["velocity"] > 0.0
        options |= {"motoring": drive, "braking": ~drive}
    for name, word in (("velocity", "speed"), ("torque", "torque"), ("body speed", "body speed")):
        if name in x:
            size = np.abs(x[name])
            options[f"low {word}"] = size < np.quantile(size, 1 / 3)
            options[f"high {word}"] = size > np.quantile(size, 2 / 3)
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


HEAT_S: Final = 30.0
LATEST_S: Final = 0.1
Table = tuple[tuple[str, ...], Array]
"""Names of the Q quantities, and their values (m, Q)."""


class Quantities:
    """Quantities of the samples of any row of any channel; built once for a set of logs."""

    def __init__(self, stack: Stack) -> None:
        """Take the logs."""
        self.stack = stack
        self._first = stack.starts()
        self._of_drive: dict[str, Array] | None = None

    def of(self, view: ChannelView, row: int, samples: Ints) -> Table:
        """Quantities at the samples of one row; none for channels whose samples are events or stamps."""
        joint, leg = int(view.row_joint[row]), int(view.row_leg[row])
        if view.name == Channel.SET_POINT_TO_LOAD:
            if self._of_drive is None:
                self._of_drive = _drive_signals(view.signals)
            table = {k: v[samples] if v.ndim == 1 else v[samples, row] for k, v in self._of_drive.items()}
            return tuple(table), np.stack(list(table.values()), axis=1)
        if view.name not in (
            Channel.LOAD_TO_MOTION,
            Channel.JOINT_RATES,
            Channel.BASE_WRENCH,
            Channel.STANCE_KINEMATICS,
            Channel.INERTIAL_UNIT,
        ):
            return (), np.zeros((len(samples), 0))
        at = self._first[view.run[samples]] + view.state[samples]
        table = {name: v[at, joint] for name, v in self._joint_signals.items()} if joint >= 0 else {}
        legs_joints = np.flatnonzero(view.leg_of_joint == leg) if leg >= 0 else np.zeros(0, dtype=np.intp)
        names = self.stack.recordings[0].joint_names
        for other in legs_joints[legs_joints != joint]:
            kind = names[other].rsplit("_", 1)[-1]
            table |= {f"{what} of {kind}": self._joint_signals[what][at, other] for what in ("position", "torque")}
        if joint < 0:
            table |= {name: values[at] for name, values in self._body_signals.items()}
        return tuple(table), np.stack(list(table.values()), axis=1)

    def _smooth(self, part: Callable[[Recording], Any]) -> Array:
        return smooth(self.stack.filled(part))

    @cached_property
    def _joint_signals(self) -> dict[str, Array]:
        return {
            "position": self._smooth(lambda r: r.position_rad),
            "velocity": self._smooth(lambda r: r.velocity_rad_s),
            "torque": self._smooth(lambda r: r.load_nm),
            "acceleration": self.stack.rate(self.stack.filled(lambda r: r.velocity_rad_s)),
            "torque rate": self.stack.rate(self.stack.filled(lambda r: r.load_nm)),
        }

    @cached_property
    def _body_signals(self) -> dict[str, Array]:
        velocity = self._smooth(lambda r: r.linear_vel_of_body_in_odom_m_s)
        turn = self._smooth(lambda r: r.angular_vel_of_body_in_odom_rad_s)
        attitude = self.stack.filled(lambda r: r.odom_from_body_wxyz)
        attitude = np.where(np.abs(attitude).sum(axis=1, keepdims=True) > 0.5, attitude, [1.0, 0.0, 0.0, 0.0])
        lean = projected_gravity(attitude)
        return {
            "body speed": np.linalg.norm(velocity[:, :2], axis=1),
            "vertical velocity": velocity[:, 2],
            "turn rate": turn[:, 2],
            "roll rate": turn[:, 0],
            "pitch rate": turn[:, 1],
            "pitch": np.asarray(lean[..., 0]),
            "roll": np.asarray(lean[..., 1]),
            "total torque": np.abs(self._joint_signals["torque"]).sum(axis=1),
            "time since start": self.stack.state * self.stack.period_s,
        }


def _drive_signals(s: ActuatorSignals) -> dict[str, Array]:
    power = np.maximum(s.torque_nm * s.velocity_rad_s, 0.0).sum(axis=1)
    return {
        "position": s.position_rad[s.kept],
        "velocity": s.finish(s.velocity_rad_s),
        "torque": s.finish(s.torque_nm),
        "acceleration": s.finish_rate(s.velocity_rad_s),
        "torque rate": s.finish_rate(s.torque_nm),
        "total power": power[s.kept],
        "time since start": (s.stack.state * s.stack.period_s)[s.kept],
        "torque history": s.integrated(s.load_nm**2, HEAT_S)[s.kept],
        "time since set-point": np.minimum(s.command_age_s, LATEST_S)[s.kept],
    }
