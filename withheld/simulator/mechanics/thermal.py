"""Heat in the motors: a winding within a housing, and what a hot winding costs."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from withheld.simulator.parameters import DriveParameters, ThermalParameters

COPPER_PER_K = 0.0039
"""Resistance of copper."""
MAGNET_FROM_C = 60.0
LEAST_SHARE = 0.3
REFERENCE_C = 25.0


class Motors:
    """Winding and housing temperatures of n runs, and the share of torque that is left; moved on once a state.

    C_w·dw/dt = r(w)·τ² − (w − h)/R_wh;  C_h·dh/dt = (w − h)/R_wh − (h − air)/R_ha.
    """

    def __init__(self, thermal: ThermalParameters, drive: DriveParameters, n_runs: int) -> None:
        self._thermal, self._copper = thermal, drive.copper_w_per_nm2
        self.winding_c: Array = np.tile(thermal.start_c, (n_runs, 1))
        self.housing_c: Array = np.tile(thermal.start_c - 0.3 * (thermal.start_c - thermal.air_c), (n_runs, 1))
        self.share: Array = self._share()

    def copper_w(self, motor_nm: Array) -> Array:
        """Heat in the windings at these torques, shape (n, 12)."""
        return np.asarray(self._copper * (1.0 + COPPER_PER_K * (self.winding_c - REFERENCE_C)) * np.square(motor_nm))

    def heat(self, copper_w: Array, dt_s: float) -> None:
        """Let time pass with this heat in the windings."""
        t = self._thermal
        across = (self.winding_c - self.housing_c) / t.winding_to_housing_k_per_w
        away = (self.housing_c - t.air_c) / t.housing_to_air_k_per_w
        self.winding_c = self.winding_c + dt_s * (copper_w - across) / t.winding_j_per_k
        self.housing_c = self.housing_c + dt_s * (across - away) / t.housing_j_per_k
        self.share = self._share()

    def _share(self) -> Array:
        t = self._thermal
        magnet = 1.0 - t.magnet_loss_per_k * np.maximum(self.winding_c - MAGNET_FROM_C, 0.0)
        over = (self.winding_c - t.derate_from_c) / t.derate_over_k
        return np.asarray(magnet * np.clip(1.0 - (1.0 - LEAST_SHARE) * over, LEAST_SHARE, 1.0))
