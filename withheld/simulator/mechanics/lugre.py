"""LuGre friction: bristles that bend, slip, and slip more easily the faster they go."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from withheld.simulator.parameters import DriveParameters

PRESLIDING_RAD = 1.5e-3
"""Bend of the bristles at which they slip."""
BRISTLE_DAMPING_S = 1e-3
"""Over their stiffness."""


class LuGre:
    """dz/dt = v − σ0·|v|·z/g(v), τ = σ0·z + σ1·dz/dt + σ2·v, with g = Fc + Fs·exp(−(v/vs)²).

    The bristles' equation is solved implicitly, so a step is stable however stiff they are, and its end is exact in
    steady sliding.
    Source: Canudas de Wit, Olsson, Åström, Lischinsky 1995.
    """

    def __init__(self, drive: DriveParameters, n_runs: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._stiction = drive.stiction_nm
        self._has_stiction = bool(np.any(drive.stiction_nm != 0.0))
        self._per_speed = 1.0 / drive.stribeck_rad_s
        self._viscous = drive.viscous_nm_s_per_rad
        self._stiffness = np.maximum(drive.coulomb_nm + drive.stiction_nm, 1e-6) / PRESLIDING_RAD
        self._steady = np.maximum(drive.coulomb_nm, 1e-6)
        self._per_level = dt_s * self._stiffness / self._steady
        self._damping = BRISTLE_DAMPING_S / dt_s
        self._bend: Array = np.zeros((n_runs, len(drive.coulomb_nm)))

    def torque_nm(self, velocity_rad_s: Array) -> Array:
        """What opposes the motion over this step, shape (n, 12)."""
        dt_s, level = self._dt_s, self._steady
        if self._has_stiction:
            level = level + self._stiction * np.exp(-np.square(velocity_rad_s * self._per_speed))
        ratio = self._per_level if not self._has_stiction else dt_s * self._stiffness / level
        bend = (self._bend + dt_s * velocity_rad_s) / (1.0 + ratio * np.abs(velocity_rad_s))
        bent = bend + self._damping * (bend - self._bend)
        self._bend = bend
        return np.asarray(self._stiffness * bent + self._viscous * velocity_rad_s)
