"""A peer of the diagnosis: least squares of drive parameters, joint by joint, with a threshold.

The load that the servo law does not explain is regressed on dry and viscous friction, rotor inertia, torque gain,
friction by load and a constant, which is an encoder's offset times the stiffness. What a healthy robot's numbers
scatter by comes from other robots without a fault.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels import ChannelView
from diagnosis.library.registry import LIBRARY

Array = NDArray[np.float64]

REGRESSORS: Final = ("coulomb_friction", "viscous_friction", "armature", "torque_gain", "load_friction")
CONSTANT: Final = "encoder_offset"
NAMES: Final = (*REGRESSORS, CONSTANT)


def estimates(view: ChannelView) -> Array:
    """Numbers of each joint, shape (12, len(NAMES)), from channel *set-point to load*."""
    n, joints = view.response.shape
    everywhere = np.ones(joints, dtype=np.bool_)
    columns = [LIBRARY[name].columns(view, {}, everywhere)[:, :, 0] for name in REGRESSORS]
    x = np.stack([*columns, np.ones((n, joints))], axis=2)
    found = np.zeros((joints, len(NAMES)))
    for j in range(joints):
        rows = view.usable[:, j] & np.isfinite(view.response[:, j])
        found[j] = np.linalg.lstsq(x[rows, j], view.response[rows, j], rcond=None)[0]
    return found


def ranking(own: Array, healthy: Sequence[Array]) -> Mapping[str, float]:
    """By effect, the largest number of any joint in standard deviations of healthy robots."""
    scatter = np.sqrt(np.mean(np.square(np.concatenate(healthy)), axis=0))
    return dict(zip(NAMES, (np.abs(own) / scatter).max(axis=0).tolist(), strict=True))
