"""Battery and heat: a bus that all motors share, and windings within housings that lose torque as they grow hot."""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import Array
from withheld.simulator.parameters import DriveParameters, SupplyParameters, ThermalParameters

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


BUS_TIME_S = 0.006
"""Capacitors of the bus."""
SHOWN_TIME_S = 0.04
"""Voltage and current are reported as means over about this time."""


class Battery:
    """Voltage and charge of n runs; moved on once a state."""

    def __init__(self, supply: SupplyParameters, n_runs: int) -> None:
        self._supply = supply
        self._charge = np.full(n_runs, supply.charge)
        self._slow_v = np.zeros(n_runs)
        self._power_w = np.full(n_runs, supply.idle_w)
        self.bus_v: Array = self._open_v()
        self.shown_v: Array = self.bus_v.copy()
        self.shown_a: Array = self._power_w / self.bus_v

    @property
    def charge_percent(self) -> Array:
        """Shape (n,)."""
        return np.asarray(100.0 * self._charge)

    def step(self, mechanical_w: Array, copper_w: Array, dt_s: float) -> Array:
        """Feed the motors for a while.

        Args:
            mechanical_w: Each motor's shaft power, shape (n, 12); negative where it brakes.
            copper_w: Each winding's heat, likewise.
            dt_s: How long.

        Returns:
            Bus voltage, shape (n,).
        """
        s = self._supply
        shaft = np.where(mechanical_w > 0.0, mechanical_w, s.regeneration * mechanical_w)
        asked = s.idle_w + np.sum(shaft + copper_w, axis=1)
        self._power_w = self._power_w - np.expm1(-dt_s / BUS_TIME_S) * (asked - self._power_w)
        source_v = self._open_v() - self._slow_v
        # P = (V_source − R·I)·I; more than the cells can give ends at their greatest power.
        root = np.sqrt(np.maximum(source_v**2 - 4.0 * s.resistance_ohm * self._power_w, 0.0))
        self.bus_v = 0.5 * (source_v + root)
        current = (source_v - self.bus_v) / s.resistance_ohm
        self._slow_v = self._slow_v + dt_s / s.slow_time_s * (s.slow_resistance_ohm * current - self._slow_v)
        self._charge = self._charge - source_v * current * dt_s / (3600.0 * s.capacity_wh)
        share = -np.expm1(-dt_s / SHOWN_TIME_S)
        self.shown_v = self.shown_v + share * (self.bus_v - self.shown_v)
        self.shown_a = self.shown_a + share * (current - self.shown_a)
        return self.bus_v

    def _open_v(self) -> Array:
        """A lithium cell's curve: steep at both ends, flat between."""
        s, c = self._supply, np.clip(self._charge, 0.01, 1.0)
        span = s.cell_volts_full - s.cell_volts_empty
        shape = 0.18 * c + 0.55 + 0.09 * np.tanh(8.0 * (c - 0.93)) - 0.46 * np.exp(-14.0 * c)
        return np.asarray(s.n_cells * (s.cell_volts_empty + span * (shape + 0.21 * c)))
