"""The simulator's ground: how soft a contact is, is no part of a robot's model, and no log shows it directly.

Of a few contact time constants each model gets the one with the best score on the *other* command sequences, before and
after the correction alike, so that a gap is the robot's and not the floor's. Where the ground itself is what was found,
it stays as the models say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.engine import Engine, Rollout, Tell
from diagnosis.shrink import Features, compare, features_by_sequence
from diagnosis.simulated import Script
from spot_model.mjcf import MjcfOptions
from spot_model.model_file import RobotModel
from spot_model.policy import Policy

OWN_S: Final = MjcfOptions().contact_solref[0]
TIME_CONSTANTS_S: Final = (0.008, 0.013, OWN_S, 0.03, 0.045)
"""The softest lets a foot sink by about a centimetre under Spot's weight."""
BETTER: Final = 0.95
"""Another ground than the simulator's own must score less than this share of it."""
RUNS_IN_ALL: Final = 4
"""Simulated runs on each ground, over all sequences; at least one of each."""
GROUND_EFFECTS: Final = frozenset({"ground_compliance", "ground_friction", "foot_radius", "contact_delay"})
"""Effects that a softer ground could hide."""


def best_ground(
    model: RobotModel, scripts: Sequence[Script], real: Mapping[str, Features], policy: Policy, engine: Engine,
    rng: np.random.Generator, tell: Tell,
) -> dict[str, float]:  # fmt: skip
    """Contact time constant for each sequence, chosen on the others; on itself where it is the only one.

    Args:
        model: Whose runs are compared.
        scripts: Of the real runs.
        real: Real runs' features by sequence.
        policy: The policy that ran.
        engine: Computes the runs.
        rng: Draws seeds.
        tell: Called with the share that is done.
    """
    names = sorted(name for name in real if any(s.sequence == name for s in scripts))
    if not names:
        return {}
    each = max(1, RUNS_IN_ALL // len(names))
    few = [s for name in names for s in [s for s in scripts if s.sequence == name][:each]]
    every = tuple(
        replace(script, sequence=f"{k}:{script.sequence}") for k in range(len(TIME_CONSTANTS_S)) for script in few
    )
    grounds = tuple(t for t in TIME_CONSTANTS_S for _ in few)
    (runs,) = engine.simulate([Rollout(model, every, int(rng.integers(2**31)), grounds)], tell)
    found = features_by_sequence(runs, policy)
    costs = np.full((len(names), len(TIME_CONSTANTS_S)), np.inf)
    for row, name in enumerate(names):
        parts = {str(k): found.get(f"{k}:{name}", []) for k in range(len(TIME_CONSTANTS_S))}
        standing = {k: v for k, v in parts.items() if v}
        if not standing:
            continue
        for k, distances in compare(name, real[name], standing).models.items():
            costs[row, int(k)] = float(np.mean(distances))
    return {name: _chosen(costs, row) for row, name in enumerate(names)}


def _chosen(costs: NDArray[np.float64], row: int) -> float:
    others = np.delete(costs, row, axis=0) if len(costs) > 1 else costs
    own = TIME_CONSTANTS_S.index(OWN_S)
    total = np.mean(others, axis=0)
    best = int(np.argmin(total))
    if not np.isfinite(total[own]):
        return TIME_CONSTANTS_S[best] if np.isfinite(total[best]) else OWN_S
    return TIME_CONSTANTS_S[best] if total[best] < BETTER * total[own] else OWN_S
