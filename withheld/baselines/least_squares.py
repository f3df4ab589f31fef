"""All coefficients of all library effects, at every joint, in one bounded fit; the largest change wins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.optimize import lsq_linear

from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stack
from diagnosis.library.base import LibraryEffect
from diagnosis.library.registry import LIBRARY
from diagnosis.posterior import Calibration
from diagnosis.recording import record
from diagnosis.selection.board import Board, lay_out
from diagnosis.selection.places import Robot
from spot_log import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from withheld.outcome import Answer

HAS_GAP: Final = 0.05
"""A change of less than this share of a parameter's range is called none."""
NEAR: Final = 0.5
"""Units whose change is above this share of the largest belong to the answer."""
RIDGE: Final = 1e-6
MAX_SAMPLES: Final = 1500
PER_SEQUENCE: Final = 2
"""Runs of each sequence that are fitted: scatter is not what leads this fit astray."""


def all_at_once(runs: Sequence[Run], nominal: RobotModel, policy: Policy) -> Answer:
    """One fit of everything; shapes (limits, time constants) stay at the middle of what the library tries.

    Raises:
        ValueError: No channel has data.
    """
    chosen = [run for run in runs if run.header.repeat < PER_SEQUENCE]
    logs = stack([record(run) for run in chosen])
    views, _ = build_views(logs, nominal, policy=policy)
    some = next(iter(views.values()))
    robot = Robot(logs.recordings[0].joint_names, some.leg_of_joint)
    board = lay_out(views, robot, [0] * len(chosen), ["all"], Calibration.load().tolerance)
    unknowns = _unknowns(board)
    gram, right = _normal_equations(board, unknowns)
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    low = np.concatenate([u.low for u in unknowns])
    high = np.concatenate([u.high for u in unknowns])
    root = np.linalg.cholesky(gram / np.outer(scale, scale) + RIDGE * np.eye(len(scale)))
    target = np.linalg.solve(root, right / scale)
    found = lsq_linear(root.T, target, bounds=(low * scale, high * scale), max_iter=60).x / scale
    change = np.abs(found) / (high - low)
    sizes, at = [], 0
    for u in unknowns:
        sizes.append(float(np.max(change[at : at + len(u.low)])))
        at += len(u.low)
    best = int(np.argmax(sizes))
    name = unknowns[best].effect.name
    near = [u for u, s in zip(unknowns, sizes, strict=True) if u.effect.name == name and s > NEAR * sizes[best]]
    joints = np.any([robot.units(u.effect.location)[u.unit] > 0.5 for u in near], axis=0)
    return Answer(
        has_gap=sizes[best] > HAS_GAP, effect=name, joints=robot.named(joints), detail={"change": sizes[best]}
    )


class _Unknown:
    """The coefficients of one effect at one unit."""

    def __init__(self, effect: LibraryEffect, shape: dict[str, float], unit: int) -> None:
        self.effect, self.shape, self.unit = effect, shape, unit
        bounds = np.array([(c.low, c.high) if c.low < c.high else (0.0, 1.0) for c in effect.coefficients])
        self.low, self.high = bounds[:, 0], bounds[:, 1]


def _unknowns(board: Board) -> list[_Unknown]:
    everywhere = np.ones(board.robot.n_joints, dtype=np.bool_)
    found: list[_Unknown] = []
    for effect in LIBRARY.values():
        if not effect.show(board.views):
            continue
        try:
            shapes = list(effect.shapes(board.views, everywhere))
        except (KeyError, ValueError):
            continue
        if shapes:
            shape = dict(shapes[len(shapes) // 2])
            found += [_Unknown(effect, shape, unit) for unit in range(len(board.robot.units(effect.location)))]
    if not found:
        raise ValueError("no effect of the library shows in these logs")
    return found


def _normal_equations(board: Board, unknowns: Sequence[_Unknown]) -> tuple[np.ndarray, np.ndarray]:
    places: dict[tuple[str, int], slice] = {}
    at = 0
    for u in unknowns:
        places[u.effect.name, u.unit] = slice(at, at + len(u.low))
        at += len(u.low)
    gram, right = np.zeros((at, at)), np.zeros(at)
    effects = {u.effect.name: u for u in unknowns}
    columns = {name: board.columns(u.effect, u.shape) for name, u in effects.items()}
    for number, block in enumerate(board.blocks):
        thin = slice(None, None, max(1, len(block.y) // MAX_SAMPLES))
        parts, rows = [], []
        for name, made in columns.items():
            for k, unit in enumerate(made.units[number]):
                parts.append(made.x[number][thin, k])
                rows.append(np.arange(at)[places[name, int(unit)]])
        if not parts:
            continue
        x, where, y = np.concatenate(parts, axis=1).astype(np.float64), np.concatenate(rows), block.y[thin]
        # Each block counts by its independent samples and what it leaves unexplained.
        weight = block.n_independent / len(y) / (float(np.mean(y**2)) + block.tolerance**2 + 1e-9)
        gram[np.ix_(where, where)] += weight * (x.T @ x)
        right[where] += weight * (x.T @ y)
    return gram, right
