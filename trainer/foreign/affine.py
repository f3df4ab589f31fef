"""A foreign observation as an affine map of ours: every layout of the same quantities is one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot_model.policy.observation import COLUMNS, N_OBSERVATION, OBSERVATION
from trainer.foreign.description import ForeignPolicy, Term, common_scale
from trainer.foreign.terms import LAST_ACTION

Array = NDArray[np.float64]
_FIELDS = {field.name: field for field in OBSERVATION}


@dataclass(frozen=True)
class ObservationMap:
    """``theirs = scale · clip(ours @ matrix + offset, low, high)``.

    ``ours`` holds the last ticks, the newest first: shape (history · 48,). The rest has one column a foreign number.
    """

    matrix: Array
    offset: Array
    low: Array
    high: Array
    scale: Array

    def __call__(self, ours: Array) -> Array:
        """Foreign observations, shape (..., n), of ours, shape (..., history · 48)."""
        return np.asarray(self.scale * np.clip(ours @ self.matrix + self.offset, self.low, self.high))


def observation_map(policy: ForeignPolicy) -> ObservationMap:
    """The map of a policy whose contract names its action's joints in their order."""
    n = policy.width
    matrix, offset = np.zeros((policy.history * N_OBSERVATION, n)), np.zeros(n)
    low, high, scale = np.full(n, -np.inf), np.full(n, np.inf), np.ones(n)
    start = 0
    default = dict(zip(policy.joint_names, policy.default_position_rad, strict=True))
    gain = np.array(policy.action_scale_rad) / common_scale(policy)
    for term in policy.terms:
        for age in reversed(range(term.history)):
            columns = slice(start, start + term.width)
            rows = _rows(term, policy.joint_names) + age * N_OBSERVATION
            matrix[rows, np.arange(columns.start, columns.stop)] = _weights(term, policy.joint_names, gain)
            if term.is_absolute:
                offset[columns] = [default[name] for name in term.joint_names]
            low[columns], high[columns] = term.clip
            scale[columns] = term.scale
            start += term.width
    return ObservationMap(matrix, offset, low, high, scale)


def _rows(term: Term, joint_names: tuple[str, ...]) -> NDArray[np.intp]:
    """Where the term's numbers stand in one tick of our observation."""
    start = COLUMNS[term.field].start
    if not _FIELDS[term.field].is_of_joints:
        return np.arange(start, start + term.width)
    return start + np.array([joint_names.index(name) for name in term.joint_names])


def _weights(term: Term, joint_names: tuple[str, ...], gain: Array) -> Array:
    """Our last action is theirs times each joint's share of the common scale; everything else is the same number."""
    if term.field != LAST_ACTION:
        return np.ones(term.width)
    return np.asarray(1.0 / gain[[joint_names.index(name) for name in term.joint_names]])
