"""The surroundings of a robot: how soft the ground is, and what the robot's own estimator makes of its velocity.

They are no part of a robot's model, no log shows them directly, and a gait depends on them more than on most effects:
a tenth of the ground's time constant moves the measure by as much as two real runs differ. So each model gets, for each
command sequence, the surroundings with the best score on the *other* sequences, the nominal and the corrected model
alike, so that a gap is the robot's and not the floor's. Where an effect that was found is itself one of the ground or
of the estimator, the ones that suit the corrected model serve both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.engine import Engine, Rollout, Tell
from diagnosis.shrink import Features, compare, features_by_sequence
from diagnosis.simulated import Script, Surroundings
from spot_model.model_file import RobotModel
from spot_model.policy import Policy

OWN: Final = Surroundings()
"""The simulator's."""
STEP: Final = 1.3
TIME_CONSTANTS_S: Final = tuple(OWN.contact_time_constant_s * STEP**k for k in range(-4, 4))
"""From 7 ms, as hard as the physics step can follow, to 44 ms: a foot sinks by a centimetre under Spot's weight."""
FINER: Final = (STEP ** (-2 / 3), STEP ** (-1 / 3), STEP ** (1 / 3), STEP ** (2 / 3))
DAMPING_RATIOS: Final = (0.8, 1.25)
ODOMETRY_S: Final = 0.05
"""Tried first; which of the other times it is matters little."""
ALL_ODOMETRY_S: Final = (0.0, 0.02, ODOMETRY_S, 0.12)
BETTER: Final = 0.95
"""Other surroundings than the simulator's own must score less than this share of them."""
SMALL: Final = 0.01
"""No score counts as less."""
MAX_SEQUENCES: Final = 4
"""So many command sequences serve to choose; one simulated run of each for each choice."""
MAX_TICKS: Final = 200
"""Of a run, from its start."""
SURROUNDING_EFFECTS: Final = frozenset({
    "ground_compliance", "ground_friction", "foot_radius", "contact_delay", "velocity_estimate", "imu_tilt",
})  # fmt: skip
"""Effects that other surroundings could hide."""


class _Tried:
    """Scores of surroundings by sequence: one simulated run of each."""

    def __init__(
        self, model: RobotModel, scripts: Sequence[Script], real: Mapping[str, Features], policy: Policy,
        engine: Engine, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        names = sorted(name for name in real if any(s.sequence == name for s in scripts))
        # Without repeats a sequence's distances have another unit.
        names = [name for name in names if len(real[name]) > 1] or names
        if len(names) > MAX_SEQUENCES:
            names = [names[i * len(names) // MAX_SEQUENCES] for i in range(MAX_SEQUENCES)]
        self.names = names
        self._model, self._policy, self._engine, self._rng = model, policy, engine, rng
        self._real = {name: [f[:MAX_TICKS] for f in real[name]] for name in names}
        first = [next(s for s in scripts if s.sequence == name) for name in names]
        self._scripts = [replace(s, velocity_command=s.velocity_command[:MAX_TICKS]) for s in first]
        self._costs: dict[Surroundings, NDArray[np.float64]] = {}

    def add(self, some: Sequence[Surroundings], tell: Tell) -> None:
        """Try all that were not tried yet, side by side."""
        new = [s for s in dict.fromkeys(some) if s not in self._costs]
        if not new:
            return
        every = tuple(replace(s, sequence=f"{k}:{s.sequence}") for k in range(len(new)) for s in self._scripts)
        around = tuple(s for s in new for _ in self._scripts)
        seed = int(self._rng.integers(2**31))
        (runs,) = self._engine.simulate([Rollout(self._model, every, seed, around, only_ticks=True)], tell)
        found = features_by_sequence(runs, self._policy)
        costs = np.full((len(new), len(self.names)), np.inf)
        for column, name in enumerate(self.names):
            parts = {str(k): f for k in range(len(new)) if (f := found.get(f"{k}:{name}"))}
            if parts:
                for k, distances in compare(name, self._real[name], parts).models.items():
                    costs[int(k), column] = float(np.mean(distances))
        self._costs.update(zip(new, np.where(np.isfinite(costs), costs, np.inf), strict=True))

    def best_without(self, name: str) -> Surroundings:
        """With the best geometric mean over all other sequences; over itself where it is the only one."""
        keep = [i for i, n in enumerate(self.names) if n != name] or list(range(len(self.names)))
        # Of logarithms, so that no sequence outweighs the others.
        total = {s: float(np.exp(np.mean(np.log(np.maximum(cost[keep], SMALL))))) for s, cost in self._costs.items()}
        best = min(total, key=lambda s: total[s])
        return best if total[best] < BETTER * total[OWN] else OWN

    def centres(self) -> list[Surroundings]:
        """The best for each sequence."""
        return list(dict.fromkeys(self.best_without(name) for name in self.names))


def best_surroundings(
    model: RobotModel, scripts: Sequence[Script], real: Mapping[str, Features], policy: Policy, engine: Engine,
    rng: np.random.Generator, tell: Tell,
) -> dict[str, Surroundings]:  # fmt: skip
    """Surroundings for each sequence, chosen on the others; on itself where it is the only one.

    First hard and soft ground, then around the best the estimator, the ground finer, and how it damps.

    Args:
        model: Whose runs are compared.
        scripts: Of the real runs.
        real: Real runs' features by sequence.
        policy: The policy that ran.
        engine: Computes the runs.
        rng: Draws seeds.
        tell: Called with the share that is done.
    """
    tried = _Tried(model, scripts, real, policy, engine, rng)
    if not tried.names:
        return {}
    tried.add(
        [OWN, *(replace(OWN, contact_time_constant_s=t, odometry_time_s=ODOMETRY_S) for t in TIME_CONSTANTS_S)],
        lambda share: tell(0.5 * share),
    )
    tried.add(
        [replace(c, odometry_time_s=t) for c in tried.centres() for t in ALL_ODOMETRY_S],
        lambda share: tell(0.5 + 0.15 * share),
    )
    tried.add(
        [
            replace(c, contact_time_constant_s=c.contact_time_constant_s * factor)
            for c in tried.centres() for factor in FINER
        ],
        lambda share: tell(0.65 + 0.2 * share),
    )  # fmt: skip
    tried.add(
        [replace(c, contact_damping_ratio=d) for c in tried.centres() for d in DAMPING_RATIOS],
        lambda share: tell(0.85 + 0.15 * share),
    )
    return {s: tried.best_without(s) for s in sorted({s.sequence for s in scripts})}
