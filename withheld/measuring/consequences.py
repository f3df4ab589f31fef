"""What a fault does to its robot, in units that a person knows: by runs of the same commands with it and without it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from withheld.features import Walk
from withheld.measuring.distances import by_sequence
from withheld.outcome import Change, Consequences

HELD_TICKS: Final = 50
"""A top speed was held for so many ticks, about 1 s."""


def consequences(walks: Sequence[Walk], twins: Sequence[Walk]) -> Consequences:
    """Changes from runs without a fault to runs with it, each measured up to a fall.

    Args:
        walks: Of the robot with the fault.
        twins: Of the same robot without it.
    """
    before, after = _figures(twins), _figures(walks)
    return Consequences(**{name: Change(before=before[name], after=after[name]) for name in before})


def _figures(walks: Sequence[Walk]) -> dict[str, float | None]:
    """Means over the runs of a sequence, then over sequences, of the top speed the largest; None without a long run."""
    own = np.array([np.mean([_of_run(walk) for walk in runs], axis=0) for runs in by_sequence(walks).values()])
    top, mean, power = (own[:, 0].max(), *own[:, 1:].mean(axis=0)) if len(own) else (None, None, None)
    share = np.mean([walk.is_fallen for walk in walks]) if walks else None
    return {"top_speed": top, "mean_speed": mean, "power": power, "fall_share": share}


def _of_run(walk: Walk) -> tuple[float, float, float]:
    """Top and mean forward speed, m/s, and mean positive power of the joints, W."""
    forward = walk.signals["body motion"][:, 0]
    held = np.convolve(forward, np.full(HELD_TICKS, 1.0 / HELD_TICKS), mode="valid")
    power = np.maximum(walk.signals["torque"] * walk.signals["joint motion"], 0.0).sum(axis=1)
    return float(held.max()), float(forward.mean()), float(power.mean())
