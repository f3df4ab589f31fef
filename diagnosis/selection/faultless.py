"""What robots without a fault look like to the diagnosis: learned, number by number, by one script.

``lab/benchmarks/calibrate_diagnosis.py`` writes ``faultless.json`` from simulated robots of the calibrating catalogue,
with ordinary errors 0.5 to 5 times the usual; the file says from how many.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from diagnosis.decision_constants import LEAST_NATS
from spot_model.io.settings import Settings

UNLEARNED: Final = {"ground_slope": "imu_tilt", "foot_drag": "viscous_friction"}
"""Effects that no faultless robot was asked about yet, with the learned one whose formula each shares: the attitude of
standing feet, and a drag on swinging legs."""
CONVEX_BELOW: Final = 1.0 / np.e
"""The bound on odds holds for p values below this."""


class Tail(Settings):
    """How large a statistic is on faultless robots: its median, and its upper tenth, which falls off exponentially."""

    median: float
    tenth: float
    """One robot in ten is above."""
    beyond: float
    """By how much, in the mean."""

    def tail(self, value: float) -> float:
        """Share of faultless robots that are farther up."""
        if value <= self.tenth:
            # Evenly from the median to the tenth; below the median nothing is asked.
            spread = max(self.tenth - self.median, 1e-9)
            return float(np.clip(0.5 - 0.4 * (value - self.median) / spread, 0.1, 1.0))
        return float(0.1 * np.exp(-(value - self.tenth) / max(self.beyond, 1e-9)))

    def at(self, share: float) -> float:
        """The value that so small a share of faultless robots exceeds."""
        return self.tenth + self.beyond * float(np.log(0.1 / share))


class Faultless(Settings):
    """What was learned, and from what."""

    robots: int
    command: str
    gains: dict[str, float]
    """By effect, nats that it adds at most on all faultless robots but so few that all effects together are named on
    one in twenty."""
    left: dict[str, Tail]
    """By channel and by gap, the logarithm of what the corrected model leaves over what it may."""

    def price(self, effect: str) -> float:
        """Nats at which the odds of an effect are even: what it adds on faultless robots, and odds of 20 to 1."""
        return max(LEAST_NATS, self.gains.get(effect, self.gains.get(UNLEARNED.get(effect, ""), 0.0)))


def even_odds(p: float) -> float:
    """Largest odds for something beyond chance that a p value can carry, 1 / (−e p log p).

    Source: Sellke, Bayarri and Berger, The American Statistician 55 (2001) 62 to 71.
    """
    p = max(p, float(np.finfo(np.float64).tiny))
    return float(1.0 / (-np.e * p * np.log(p))) if p < CONVEX_BELOW else 1.0


FAULTLESS: Final = Faultless.model_validate_json((Path(__file__).parent / "faultless.json").read_bytes())
