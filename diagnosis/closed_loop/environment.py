"""The surroundings of a robot: its ground, and what the robot's own estimator makes of its velocity.

They are no part of a robot's model, no log shows them directly, and a gait depends on them more than on most effects: a
tenth of the ground's time constant moves the measure by as much as two real runs differ. So the corrected model gets,
for each command sequence, the surroundings with the best score on the *other* sequences, and models with less of what
was found share them, so that a gap is the robot's and not the floor's.

The score is the geometric mean of the headline distance and that of the body's velocity as the policy sees it. One
simulated run scatters about as much as the score varies near its best. So its logarithm is taken for a quadratic in the
surroundings, fitted to runs that are spread over them, and its lowest place is the choice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.stats import qmc

from diagnosis.channels import Array
from diagnosis.closed_loop.shrink import (
    QUANTILES,
    Cuts,
    features_by_sequence,
    pair_distances,
    sequence_distances,
    sequence_name,
    simulated_features,
)
from diagnosis.closed_loop.simulation import RolloutEngine, run_all
from spot_log.read.run import Run
from spot_model.effects.bodies import GroundCompliance, GroundFriction
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.io.model_file import RobotModel
from spot_model.policy.observation import observed
from spot_model.policy.policy import Policy
from spot_model.robot.mjcf import MjcfOptions
from trainer.signals.policy_ticks import MIN_TICKS, Script, policy_ticks
from trainer.simulate.engine import Tell

_OWN: Final = MjcfOptions().contact_solref
HARDEST_S: Final = 2.0 * MjcfOptions().timestep_s
"""No contact has a shorter time constant: a model is trained in physics steps of this length's half, and MuJoCo lets no
contact act faster than in two."""
LEAST_DAMPING: Final = _OWN[1] + next(p.low for p in GroundCompliance.parameters() if p.name == "damping_ratio")
"""No contact has a smaller damping ratio: feet would bounce."""


@dataclass(frozen=True)
class Surroundings:
    """The ground and the estimator; the simulator's own by default."""

    contact_time_constant_s: float = _OWN[0]
    contact_damping_ratio: float = _OWN[1]
    friction_scale: float = 1.0
    """Of the ground's sliding friction."""
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
        friction, odometry = GroundFriction(scale=self.friction_scale), LegOdometry(time_s=self.odometry_time_s)
        added = tuple(effect for effect in (ground, friction, odometry) if not effect.is_null)
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
LOW: Final = np.array([np.log(HARDEST_S), np.log(0.5), np.log(0.5), 0.0])
HIGH: Final = np.array([np.log(0.034), np.log(2.0), np.log(1.4), 40.0])
"""Among what is looked: logarithms of the time constant (at 34 ms a foot sinks by a centimetre under Spot's weight), of
the damping ratio and of the friction's scale (coefficients of 0.4 to 1.1), and the rate 1/T of the odometry, 1/s."""
SLOWEST_S: Final = 2.0
"""An odometry of more time reports a velocity that is as good as true."""
WIDE, NEAR = 32, 16
"""Number of surroundings that are tried: all over the bounds, then within half of them around the best."""
LOWEST: Final = 40
"""The lowest place is the mean of so many of so many places: near it a surface is flat."""
RIDGE: Final = 1.0
"""What a coefficient's square costs, in squares of a run's deviation: with three runs a coefficient, scatter counts."""
BETTER: Final = 0.95
"""Other surroundings than the simulator's own must score less than this share of them."""
MEASURES: Final = (0, 1)
"""The headline distance, and that of the body's velocity."""
SMALL: Final = 0.01
"""No score counts as less."""
MAX_SEQUENCES: Final = 4
"""Number of command sequences that serve to choose; each choice takes one simulated run of each."""
MAX_TICKS: Final = 300
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

    def __init__(self, model: RobotModel, scripts: Sequence[Script], runs: Sequence[Run], policy: Policy) -> None:
        real = features_by_sequence(runs, policy)
        names = sorted(name for name in real if any(s.sequence == name for s in scripts))
        # Without repeats a sequence's distances have another unit.
        names = [name for name in names if len(real[name]) > 1] or names
        if len(names) > MAX_SEQUENCES:
            names = [names[i * len(names) // MAX_SEQUENCES] for i in range(MAX_SEQUENCES)]
        self.names = names
        self._model, self._policy = model, policy
        self._real = {name: [f[:MAX_TICKS] for f in real[name]] for name in names}
        self._seen = {
            name: _seen([r for r in runs if sequence_name(r) == name and len(policy_ticks(r)) >= MIN_TICKS])
            for name in names
        }
        first = [next(s for s in scripts if s.sequence == name) for name in names]
        self._scripts = [replace(s, velocity_command=s.velocity_command[:MAX_TICKS]) for s in first]
        self._places, self._costs = np.empty((0, len(LOW))), np.empty((0, len(MEASURES), len(names)))

    def add(self, places: Array, engine: RolloutEngine, rng: np.random.Generator, tell: Tell) -> None:
        """Score surroundings, shape (n, 4), by one simulated run of each sequence."""
        jobs = []
        for k, place in enumerate(places):
            model = _surroundings_at(place).around(self._model)
            jobs += [(model, replace(script, sequence=f"{k}:{script.sequence}")) for script in self._scripts]
        runs = run_all(jobs, engine, rng, tell, only_ticks=True)
        found = simulated_features(runs, self._policy)
        costs = np.empty((len(places), len(MEASURES), len(self.names)))
        for column, name in enumerate(self.names):
            parts = {str(k): found[f"{k}:{name}"] for k in range(len(places))}
            for row, distances in sequence_distances(name, self._real[name], parts).models.items():
                costs[int(row), 0, column] = np.mean(distances)
            mine = _seen(runs[column :: len(self.names)])
            costs[:, 1, column] = pair_distances(mine, self._seen[name], _apart).mean(axis=1)
        costs = np.log(np.maximum(costs, SMALL))
        self._places, self._costs = np.concatenate([self._places, places]), np.concatenate([self._costs, costs])

    def best_without(self, *names: str) -> Array:
        """Where the geometric mean over all other sequences is lowest; over all where there are no others."""
        surface = self._surface(MEASURES, [n for n in self.names if n not in names] or self.names)
        where = _places()[np.argsort(surface(_places()))[:LOWEST]].mean(axis=0)
        at_best, at_own = surface(np.stack([where, _OWN_PLACE]))
        return np.asarray(where if at_best < at_own + np.log(BETTER) else _OWN_PLACE)

    def _surface(self, measures: Sequence[int], names: Sequence[str]) -> Callable[[Array], Array]:
        """A quadratic in the places, fitted to the mean logarithm of the scores of some sequences."""
        y = self._costs[:, measures][:, :, [self.names.index(n) for n in names]].mean(axis=(1, 2))
        # What is far from the best need not be told well.
        weight = np.exp(-2.0 * (y - y.min()))
        x = _quadratic(self._places)
        ridge = RIDGE * np.diag([0.0, *np.ones(x.shape[1] - 1)])
        coefficients = np.linalg.solve(x.T @ (weight[:, None] * x) + ridge, x.T @ (weight * y))
        return lambda places: np.asarray(_quadratic(places) @ coefficients)

    def doubt(self) -> float:
        """What the choice adds to the error of a mean distance: a jackknife over the sequences that it is made on."""
        squares = []
        for name in self.names:
            others = [n for n in self.names if n != name]
            if len(others) < 2:
                continue
            at = [self.best_without(name), *(self.best_without(name, other) for other in others)]
            costs = np.exp(self._surface(MEASURES[:1], [name])(np.stack(at)))
            moved = costs[1:] - costs[0]
            squares.append((len(others) - 1) / len(others) * float(np.sum(np.square(moved))))
        return float(np.sqrt(np.mean(squares))) if squares else 0.0


def best_surroundings(
    model: RobotModel,
    scripts: Sequence[Script],
    runs: Sequence[Run],
    policy: Policy,
    engine: RolloutEngine,
    rng: np.random.Generator,
    tell: Tell,
) -> ChosenSurroundings:
    """Surroundings of a model for each sequence, chosen on the others; on itself where it is the only one.

    First all over the bounds, then around the best. ``runs`` are the real ones.
    """
    scores = _Scores(model, scripts, runs, policy)
    if not scores.names:
        return ChosenSurroundings({})
    wide = 2.0 * qmc.Sobol(len(LOW), rng=np.random.default_rng(1)).random(WIDE) - 1.0
    scores.add(np.concatenate([_OWN_PLACE[None], wide]), engine, rng, lambda share: tell(share * WIDE / (WIDE + NEAR)))
    near = qmc.Sobol(len(LOW), rng=np.random.default_rng(2)).random(NEAR) - 0.5
    places = np.clip(scores.best_without() + near, -1.0, 1.0)
    scores.add(places, engine, rng, lambda share: tell((WIDE + share * NEAR) / (WIDE + NEAR)))
    every = sorted({s.sequence for s in scripts})
    by_sequence = {s: _surroundings_at(scores.best_without(s)) for s in every}
    return ChosenSurroundings(by_sequence, _surroundings_at(scores.best_without()), scores.doubt())


def _seen(runs: Sequence[Run]) -> Cuts:
    """Quantiles of the body's velocity as the policy sees it, of each run up to each tick, shape (Q, 3)."""
    rows = [policy_ticks(run, MIN_TICKS)[:MAX_TICKS] for run in runs]
    seen = [
        observed(run.ticks.observation[own], "linear_vel_of_body_in_body_m_s")
        for run, own in zip(runs, rows, strict=True)
    ]

    @cache
    def digest(i: int, n: int) -> Array:
        return np.sort(seen[i][:n].astype(np.float64), axis=0)[(QUANTILES * n).astype(np.intp)]

    return Cuts([len(own) for own in rows], digest)


def _apart(first: Array, second: Array) -> float:
    return float(np.mean(np.abs(first - second)))


def _surroundings_at(place: Array) -> Surroundings:
    """Those of a place, whose coordinates go from -1 at :data:`LOW` to 1 at :data:`HIGH`."""
    if np.array_equal(place, _OWN_PLACE):
        return OWN
    time_s, ratio, friction, rate = LOW + 0.5 * (place + 1.0) * (HIGH - LOW)
    odometry_s = 1.0 / rate if rate > 1.0 / SLOWEST_S else 0.0
    return Surroundings(float(np.exp(time_s)), float(np.exp(ratio)), float(np.exp(friction)), float(odometry_s))


_OWN_VALUES: Final = np.array(
    [*np.log([OWN.contact_time_constant_s, OWN.contact_damping_ratio, OWN.friction_scale]), 0.0]
)
_OWN_PLACE: Final = 2.0 * (_OWN_VALUES - LOW) / (HIGH - LOW) - 1.0


def _quadratic(places: Array) -> Array:
    """1, the coordinates and their products, shape (n, 15)."""
    first, second = np.triu_indices(places.shape[1])
    return np.concatenate([np.ones((len(places), 1)), places, places[:, first] * places[:, second]], axis=1)


@cache
def _places() -> Array:
    """Places all over the bounds."""
    return np.asarray(2.0 * qmc.Sobol(len(LOW), rng=np.random.default_rng(0)).random(4096) - 1.0)
