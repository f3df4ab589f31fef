"""A peer of the diagnosis: numbers of a MuJoCo model, fitted to logs by `mujoco.sysid`, with a threshold.

What ../mujoco_sysid.py identifies, and beside it viscous friction and the body's mass. What a healthy robot's numbers
scatter by, and about, comes from other robots without a fault.

    pip install 'mujoco[sysid]==4.0.0'
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from mujoco_sysid import PARAMETERS, fitted, position_servos, some, windows
from numpy.typing import NDArray

from spot_log import Run

Array = NDArray[np.float64]

RANGES: Final = {
    **PARAMETERS,
    "hip_damping_nm_s_per_rad": (0.1, 0.0, 2.0),
    "knee_damping_nm_s_per_rad": (0.1, 0.0, 2.0),
    "body_mass_kg": (17.0, 8.0, 35.0),
}
EFFECTS: Final = {
    "friction_nm": "coulomb_friction",
    "inertia_kg_m2": "armature",
    "damping_nm_s_per_rad": "viscous_friction",
    "torque_max_nm": "torque_limit",
    "torque_min_nm": "torque_limit",
    "command_delay_s": "command_delay",
    "body_mass_kg": "payload_mass",
}
"""By the end of a parameter's name, the effect that it is a number of."""
WINDOW_S: Final = 0.03
PIECES: Final = 60


def estimates(runs: Sequence[Run]) -> Array:
    """All numbers of :data:`RANGES`."""
    spec = position_servos()
    model = spec.copy().compile()
    pieces = [piece for run in runs for piece in windows(run, model, WINDOW_S)]
    result, _, _ = fitted(spec, some(pieces, PIECES), RANGES)
    return np.asarray(result.x, dtype=np.float64)


def ranking(own: Array, healthy: Sequence[Array]) -> Mapping[str, float]:
    """By effect, how far its number is from those of healthy robots, in their standard deviations."""
    usual = np.stack(healthy)
    away = np.abs(own - usual.mean(axis=0)) / np.maximum(usual.std(axis=0), 1e-9)
    out: dict[str, float] = {}
    for name, distance in zip(RANGES, away, strict=True):
        effect = next(e for end, e in EFFECTS.items() if name.endswith(end))
        out[effect] = max(out.get(effect, 0.0), float(distance))
    return out
