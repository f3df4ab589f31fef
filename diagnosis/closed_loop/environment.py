"""The surroundings of a robot: how soft the ground is, and what the robot's own estimator makes of its velocity.

They are no part of a robot's model, no log shows them directly, and a gait depends on them more than on most effects: a
tenth of the ground's time constant moves the measure by as much as two real runs differ. So the corrected model gets,
for each command sequence, the surroundings with the best score on the *other* sequences, and models with less of what
was found share them, so that a gap is the robot's and not the floor's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.closed_loop.shrink import Features, compare, simulated_features
from diagnosis.closed_loop.simulation import Rollouts, run_all
from spot_model.effects.bodies import GroundCompliance
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot.mjcf import MjcfOptions
from trainer.signals.policy_ticks import Script
from trainer.simulate.engine import Tell

_OWN: Final = MjcfOptions().contact_solref
HARDEST_S: Final = 2.0 * MjcfOptions().timestep_s
"""No contact has a shorter time constant: a model is trained in physics steps of this length's half, and MuJoCo lets no
contact act faster than in two."""
LEAST_DAMPING: Final = _OWN[1] + next(p.low for p in GroundCompliance.parameters() if p.name == "damping_ratio")
"""No contact has a smaller damping ratio: feet would bounce."""


@dataclass(frozen=True)
class Surroundings:
    """The ground's contact and the estimator; the simulator's own by default."""

    contact_time_constant_s: float = _OWN[0]
    contact_damping_ratio: float = _OWN[1]
    odometry_time_s: float = 0.0
    """Time in which standing legs pull the reported velocity; 0 for a true velocity. See :class:`LegOdometry`."""

    def around(self, model: RobotModel) -> RobotModel:
        """The model in these surroundings. They come first: what is wrong with an estimate comes on top of it.

        A ground that the model has itself adds to this one; together they stay within :data:`HARDEST_S` and
        :data:`LEAST_DAMPING`.
        """
        own_s, own_ratio = _own_ground(model)
        ground = GroundCompliance(
            time_constant_s=max(self.contact_time_constant_s, HARDEST_S - own_s) - _OWN[0],
            damping_ratio=max(self.contact_damping_ratio, LEAST_DAMPING - own_ratio) - _OWN[1],
        )
        odometry = LegOdometry(time_s=self.odometry_time_s)
        added = tuple(effect for effect in (ground, odometry) if not effect.is_null)
        return replace(model, effects=(*added, *model.effects))


def _own_ground(model: RobotModel) -> tuple[float, float]:
    """What the model's own effects add to time constant and damping ratio, at the leg with the least of each."""
    found = [e for e in model.effects if isinstance(e, GroundCompliance)]
    sums = [
        sum((np.where(e.mask, getattr(e, name), 0.0) for e in found), start=np.zeros(1))
        for name in ("time_constant_s", "damping_ratio")
    ]
    return float(np.min(sums[0])), float(np.min(sums[1]))


OWN: Final = Surroundings()
"""The simulator's."""
STEP: Final = 1.3
TIME_CONSTANTS_S: Final = tuple(OWN.contact_time_constant_s * STEP**k for k in (-2, 0, 2))
"""From 12 ms to 34 ms, at which a foot sinks by a centimetre under Spot's weight; nothing is tried below
:data:`HARDEST_S`."""
FINER: Final = (STEP**-0.5, STEP**0.5)
DAMPING_RATIOS: Final = (0.8, 1.25)
ODOMETRY_S: Final = 0.05
"""Tried first; which of the other times it is matters little."""
OTHER_ODOMETRY_S: Final = (0.0, 0.12)
NEIGHBOURS: Final = 1.01 * STEP**2
"""Time constants that differ by no more are neighbours of the first choice."""
BETTER: Final = 0.95
"""Other surroundings than the simulator's own must score less than this share of them."""
SMALL: Final = 0.01
"""No score counts as less."""
MAX_SEQUENCES: Final = 4
"""Number of command sequences that serve to choose; each choice takes one simulated run of each."""
MAX_TICKS: Final = 200
"""Ticks of a run that count, from its start."""
SURROUNDING_EFFECTS: Final = frozenset(
    {"ground_compliance", "ground_friction", "foot_radius", "contact_delay", "velocity_estimate", "imu_tilt"}
)
"""Effects that other surroundings could hide."""


@dataclass(frozen=True)
class ChosenSurroundings:
    """The surroundings that suit a model."""

    by_sequence: Mapping[str, Surroundings]
    """Empty where there is nothing to choose by."""
    overall: Surroundings = OWN
    """Chosen on all sequences: what a model file gets."""
    doubt: float = 0.0
    """Standard error of the model's distance from the choice, in floors."""


class _Scores:
    """Scores of surroundings by sequence: one simulated run of each."""

    def __init__(
        self, model: RobotModel, scripts: Sequence[Script], real: Mapping[str, Features], policy: Policy
    ) -> None:
        names = sorted(name for name in real if any(s.sequence == name for s in scripts))
        # Without repeats a sequence's distances have another unit.
        names = [name for name in names if len(real[name]) > 1] or names
        if len(names) > MAX_SEQUENCES:
            names = [names[i * len(names) // MAX_SEQUENCES] for i in range(MAX_SEQUENCES)]
        self.names = names
        self._model, self._policy = model, policy
        self._real = {name: [f[:MAX_TICKS] for f in real[name]] for name in names}
        first = [next(s for s in scripts if s.sequence == name) for name in names]
        self._scripts = [replace(s, velocity_command=s.velocity_command[:MAX_TICKS]) for s in first]
        self._costs: dict[Surroundings, NDArray[np.float64]] = {}

    def add(self, some: Sequence[Surroundings], engine: Rollouts, rng: np.random.Generator, tell: Tell) -> None:
        """Score those that are new, by one simulated run of each sequence."""
        new = [s for s in dict.fromkeys(some) if s not in self._costs]
        jobs = []
        for k, surroundings in enumerate(new):
            model = surroundings.around(self._model)
            jobs += [(model, replace(script, sequence=f"{k}:{script.sequence}")) for script in self._scripts]
        found = simulated_features(run_all(jobs, engine, rng, tell, only_ticks=True), self._policy)
        costs = np.empty((len(new), len(self.names)))
        for column, name in enumerate(self.names if new else ()):
            parts = {str(k): found[f"{k}:{name}"] for k in range(len(new))}
            for row, distances in compare(name, self._real[name], parts).models.items():
                costs[int(row), column] = float(np.mean(distances))
        self._costs.update(zip(new, costs, strict=True))

    def best_without(self, *names: str) -> Surroundings:
        """With the best geometric mean over all other sequences; over all where there are no others."""
        total = self._totals(names)
        best = min(total, key=lambda s: total[s])
        return best if total[best] < BETTER * total[OWN] else OWN

    def combined(self, centre: Surroundings, names: Sequence[str]) -> Surroundings:
        """The best time constant and the best odometry beside a centre, judged without some sequences, together."""
        total = self._totals(names)

        def best(changes: list[Surroundings]) -> Surroundings:
            return min((s for s in changes if s in total), key=lambda s: total[s], default=centre)

        estimator = best([centre, *_estimators(centre)])
        return replace(best([centre, *_nearer(centre)]), odometry_time_s=estimator.odometry_time_s)

    def _totals(self, names: Sequence[str]) -> dict[Surroundings, float]:
        keep = [i for i, n in enumerate(self.names) if n not in names] or list(range(len(self.names)))
        # Of logarithms, so that no sequence outweighs the others.
        return {s: float(np.exp(np.mean(np.log(np.maximum(cost[keep], SMALL))))) for s, cost in self._costs.items()}

    def doubt(self) -> float:
        """What the choice adds to the error of a mean distance: a jackknife over the sequences that it is made on."""
        squares = []
        for column, name in enumerate(self.names):
            others = [n for n in self.names if n != name]
            if len(others) < 2:
                continue
            chosen = self._costs[self.best_without(name)][column]
            moved = [self._costs[self.best_without(name, other)][column] - chosen for other in others]
            squares.append((len(others) - 1) / len(others) * float(np.sum(np.square(moved))))
        return float(np.sqrt(np.mean(squares))) if squares else 0.0

    def centres(self) -> list[tuple[Surroundings, tuple[str, ...]]]:
        """Where to look more closely: the best of all, with the sequences that it is chosen without, none.

        Where sequences left out one at a time are neighbours no more, the best without each. More choices than that do
        not find better ones: they only fit one run's scatter.
        """
        apart = {n: self.best_without(n) for n in self.names}
        times = [s.contact_time_constant_s for s in apart.values()]
        if max(times) <= NEIGHBOURS * min(times):
            return [(self.best_without(), ())]
        return [(s, (name,)) for name, s in apart.items()]


def best_surroundings(
    model: RobotModel,
    scripts: Sequence[Script],
    real: Mapping[str, Features],
    policy: Policy,
    engine: Rollouts,
    rng: np.random.Generator,
    tell: Tell,
) -> ChosenSurroundings:
    """Surroundings of a model for each sequence, chosen on the others; on itself where it is the only one.

    First hard and soft ground, then around the best the ground and the estimator, and around both together the ground
    finer and how it damps. ``real`` holds the real runs' features by sequence.
    """
    scores = _Scores(model, scripts, real, policy)
    if not scores.names:
        return ChosenSurroundings({})
    soft = [replace(OWN, contact_time_constant_s=t, odometry_time_s=ODOMETRY_S) for t in TIME_CONSTANTS_S]
    scores.add([OWN, *soft], engine, rng, lambda share: tell(share / 3))
    around = scores.centres()
    near = [s for centre, _ in around for s in (*_nearer(centre), *_estimators(centre))]
    scores.add(near, engine, rng, lambda share: tell((1 + share) / 3))
    centres = [scores.combined(centre, names) for centre, names in around]
    scores.add([s for c in centres for s in (c, *_finer(c))], engine, rng, lambda share: tell((2 + share) / 3))
    every = sorted({s.sequence for s in scripts})
    return ChosenSurroundings({s: scores.best_without(s) for s in every}, scores.best_without(), scores.doubt())


def _nearer(centre: Surroundings) -> list[Surroundings]:
    return _with_times(centre, (1.0 / STEP, STEP))


def _estimators(centre: Surroundings) -> list[Surroundings]:
    return [replace(centre, odometry_time_s=t) for t in OTHER_ODOMETRY_S if t != centre.odometry_time_s]


def _finer(centre: Surroundings) -> list[Surroundings]:
    return [*_with_times(centre, FINER), *(replace(centre, contact_damping_ratio=d) for d in DAMPING_RATIOS)]


def _with_times(centre: Surroundings, factors: Sequence[float]) -> list[Surroundings]:
    times_s = {max(HARDEST_S, centre.contact_time_constant_s * f) for f in factors}
    return [replace(centre, contact_time_constant_s=t) for t in sorted(times_s)]
