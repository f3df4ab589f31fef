"""Commands that come late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spot_model.facts import Array
from withheld.realities.fault_kind import Ask, Built

DELAY_S = 0.012


def delay(ask: Ask) -> Built:
    """A queue on the way: a wait that wanders slowly about its mean."""
    mean = ask.size * DELAY_S
    return Built(lambda robot: robot.delays.append(_Queue(mean)), {"command_delay.delay_s": mean})


@dataclass(frozen=True)
class _Queue:
    mean_s: float
    WANDER = 0.06
    MEMORY = 0.97

    def extra_s(self, n_commands: int, rng: np.random.Generator) -> Array:
        """A mean and a first-order random walk about it."""
        steps = rng.standard_normal(n_commands) * np.sqrt(1.0 - self.MEMORY**2)
        walk = np.empty(n_commands)
        now = 0.0
        for i, step in enumerate(steps.tolist()):
            now = self.MEMORY * now + step
            walk[i] = now
        return np.asarray(np.maximum(self.mean_s * (1.0 + self.WANDER * walk), 0.0))
