"""LuGre friction: bristles that bend, slip, and slip more easily the faster they go."""

from __future__ import annotations

import numpy as np

from spot_model.facts import Array
from withheld.realities.robot import DriveParameters

PRESLIDING_RAD = 1.5e-3
"""Bend of the bristles at which they slip."""
BRISTLE_DAMPING_S = 1e-3
"""Over their stiffness."""


class LuGre:
    """dz/dt = v − σ0·|v|·z/g(v), τ = σ0·z + σ1·dz/dt + σ2·v, with g = Fc + Fs·exp(−(v/vs)²).

    The bristles' equation is linear in z while the speed holds, so a step is exact however stiff they are.
    Source: Canudas de Wit, Olsson, Åström, Lischinsky 1995.
    """

    def __init__(self, drive: DriveParameters, n_runs: int) -> None:
        self._stiction = drive.stiction_nm
        self._has_stiction = bool(np.any(drive.stiction_nm != 0.0))
        self._per_speed = 1.0 / drive.stribeck_rad_s
        self._viscous = drive.viscous_nm_s_per_rad
        self._stiffness = np.maximum(drive.coulomb_nm + drive.stiction_nm, 1e-6) / PRESLIDING_RAD
        self._steady = np.maximum(drive.coulomb_nm, 1e-6)
        self._bend: Array = np.zeros((n_runs, len(drive.coulomb_nm)))

    def torque_nm(self, velocity_rad_s: Array, dt_s: float) -> Array:
        """What opposes the motion over this step, shape (n, 12)."""
        level = self._steady
        if self._has_stiction:
            level = level + self._stiction * np.exp(-np.square(velocity_rad_s * self._per_speed))
        slip = np.abs(velocity_rad_s) * (dt_s * self._stiffness / level) + 1e-12
        share = -np.expm1(-slip)
        change = share * (velocity_rad_s * (dt_s / slip) - self._bend)
        self._bend = self._bend + change
        damping = (BRISTLE_DAMPING_S / dt_s) * change
        return np.asarray(self._stiffness * (self._bend + damping) + self._viscous * velocity_rad_s)
