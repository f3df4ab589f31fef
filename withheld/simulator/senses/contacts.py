"""The robot's contact detector: filtered forces, two thresholds, and flags that wait."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spot_model.robot.facts import N_LEGS, Array
from withheld.simulator.parameters import SensingParameters


class ContactDetector:
    """Flags of the four feet in n runs."""

    def __init__(self, sensing: SensingParameters, n_runs: int, dt_s: float) -> None:
        self._sensing = sensing
        self._blend = -np.expm1(-dt_s / sensing.contact_filter_s)
        self.force_n: Array = np.zeros((n_runs, N_LEGS))
        """Filtered."""
        self._waited: Array = np.zeros((n_runs, N_LEGS))
        self.flags: NDArray[np.bool_] = np.zeros((n_runs, N_LEGS), dtype=np.bool_)
        self.age: Array = np.zeros((n_runs, N_LEGS))
        """States since a flag was raised; 0 while it is not."""

    def see(self, force_n: Array) -> NDArray[np.bool_]:
        """Flags after another state, from true normal forces (n, 4)."""
        s = self._sensing
        self.force_n = self.force_n + self._blend * (force_n - self.force_n)
        threshold = np.where(self.flags, s.contact_off_n, s.contact_on_n)
        differs = (self.force_n > threshold) != self.flags
        self._waited = np.where(differs, self._waited + 1.0, 0.0)
        self.flags = self.flags ^ (differs & (self._waited > s.contact_hold_states))
        self.age = np.where(self.flags, self.age + 1.0, 0.0)
        return self.flags
