"""Two peers of the diagnosis that simulate: a two-sample test and a CMA-ES search, for each effect by itself.

Both begin with the nominal model and one effect of the library at a time, over all joints or one type of them, at two
sizes (a twentieth and a fifth of what the effect's numbers may be), through the robot's own commands. The two-sample
test ranks effects by the least MMD between the robot's features and a candidate's. The search goes on from the ten best
candidates by the paper's W1 + MMD, and moves each one's numbers by CMA-ES.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from diagnosis.channels import Views
from diagnosis.closed_loop.shrink import features_by_sequence
from diagnosis.closed_loop.simulation import rollouts_under, run_all
from diagnosis.closed_loop.trials import Bench
from diagnosis.library import LibraryEffect, Location
from diagnosis.library.registry import LIBRARY
from spot_log.read.run import Run
from spot_model.errors import SpotRlError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from trainer.signals.distances import SequenceReference

Array = NDArray[np.float64]

SHARES: Final = (0.05, 0.2)
SHAPES: Final = 3
MOST: Final = 16
"""Candidates of an effect, evenly chosen."""
TYPES: Final = ("hx", "hy", "kn")
SEQUENCES: Final = 2
TICKS: Final = 150
FALLEN: Final = 1e3
"""Stands for the distance of a model that falls or cannot be simulated."""
SEARCHED: Final = 10
GENERATIONS: Final = 4
POPULATION: Final = 6
SIGMA: Final = 0.4
"""Of the logarithm of a number's size."""


@dataclass(frozen=True)
class Candidate:
    """One effect at a place, with its numbers."""

    effect: LibraryEffect
    joints: tuple[str, ...]
    values: Mapping[str, float]

    def model(self, nominal: RobotModel) -> RobotModel:
        """The nominal model with it."""
        return self.effect.add_to(nominal, self.values, self.joints)

    def scaled(self, logarithms: Array) -> Candidate:
        """With numbers farther from their null values, or nearer, by these factors' logarithms; a shape stays."""
        known = {p.name: p for p in self.effect.effect.parameters()}
        values = {}
        for (name, value), by in zip(self.values.items(), np.exp(logarithms), strict=False):
            if name not in known:
                values[name] = value
                continue
            null = known[name].null if math.isfinite(known[name].null) else 0.0
            values[name] = float(np.clip(null + by * (value - null), known[name].low, known[name].high))
        return replace(self, values=values)


def candidates(views: Views) -> list[Candidate]:
    """All that are tried."""
    found = []
    for effect in LIBRARY.values():
        everywhere = np.ones(12, dtype=np.bool_)
        try:
            shapes = effect.shapes(views, everywhere)
        except (KeyError, ValueError):
            continue
        shapes = tuple(shapes[i] for i in np.unique(np.linspace(0, len(shapes) - 1, SHAPES).round().astype(int)))
        sizes = [
            [share * bound * (np.arange(len(effect.coefficients)) == k) for share in SHARES]
            for k, c in enumerate(effect.coefficients)
            if c.is_free
            for bound in (c.low, c.high)
            if bound
        ]
        rows = [row for some in sizes for row in some] or [np.array([c.high for c in effect.coefficients])]
        is_of_joints = effect.location is Location.JOINT and not effect.singly
        places = (("all",), *((kind,) for kind in TYPES)) if is_of_joints else (("all",),)
        own = [
            Candidate(effect, place, effect.values(row, shape)) for shape in shapes for row in rows for place in places
        ]
        found += [own[i] for i in np.unique(np.linspace(0, len(own) - 1, MOST).round().astype(int))]
    return found


class Distances:
    """Distances from the robot's runs to those of models."""

    def __init__(self, runs: Sequence[Run], policy: Policy, seed: int) -> None:
        bench = Bench.of(runs, policy, rollouts_under(policy))
        if bench is None:
            raise SpotRlError("no log is long enough")
        self._bench, self._rng = bench, np.random.default_rng(seed)
        real = {name: [f[:TICKS] for f in own] for name, own in bench.real().items()}
        names = bench.sequences[:SEQUENCES]
        first = [next(s for s in bench.scripts if s.sequence == name) for name in names]
        self._scripts = [replace(s, velocity_command=s.velocity_command[:TICKS]) for s in first]
        self._references = {name: SequenceReference.build(name, real[name]) for name in names}

    def to(self, models: Sequence[RobotModel]) -> Array:
        """W1 and MMD in floors, mean over the sequences, shape (len(models), 2)."""
        jobs = [
            (model, replace(script, sequence=f"{k}:{script.sequence}"))
            for k, model in enumerate(models)
            for script in self._scripts
        ]
        made = run_all(jobs, self._bench.engine, self._rng, lambda _: None, only_ticks=True)
        features = features_by_sequence(made, self._bench.policy)
        found = np.zeros((len(models), 2))
        for k in range(len(models)):
            parts = []
            for name, reference in self._references.items():
                own = features.get(f"{k}:{name}")
                apart = reference.distances(own[0]).mean(axis=0) / reference.scale if own else np.full(2, FALLEN)
                parts.append(np.nan_to_num(apart, nan=FALLEN))
            found[k] = np.mean(parts, axis=0)
        return found


def distances_of(measure: Distances, nominal: RobotModel, tried: Sequence[Candidate]) -> Array:
    """Of all candidates, an effect a batch; shape (len(tried), 2)."""
    found = np.full((len(tried), 2), FALLEN)
    for name in dict.fromkeys(c.effect.name for c in tried):
        rows, models = [], []
        for i, candidate in enumerate(tried):
            if candidate.effect.name == name:
                try:
                    models.append(candidate.model(nominal))
                except (SpotRlError, ValueError):
                    continue
                rows.append(i)
        try:
            found[rows] = measure.to(models) if models else found[rows]
        except (SpotRlError, ValueError):
            continue
    return found


def nearest(tried: Sequence[Candidate], distances: Array) -> dict[str, float]:
    """By effect, the least distance, negative, so that the nearest is the largest."""
    found: dict[str, float] = {}
    for candidate, distance in zip(tried, distances.tolist(), strict=True):
        found[candidate.effect.name] = max(found.get(candidate.effect.name, -np.inf), -distance)
    return found


def searched(
    measure: Distances, nominal: RobotModel, tried: Sequence[Candidate], distances: Array, seed: int
) -> dict[str, float]:
    """The same after CMA-ES from each effect's best candidate; effects that are not searched keep their distance."""
    both = distances.mean(axis=1)
    found = nearest(tried, both)
    for name in sorted(found, key=lambda n: -found[n])[:SEARCHED]:
        own = [i for i, c in enumerate(tried) if c.effect.name == name]
        start = tried[min(own, key=lambda i: both[i])]
        n = max(2, len(start.values))
        optimiser = CMA(mean=np.zeros(n), sigma=SIGMA, population_size=POPULATION, seed=seed)
        for _ in range(GENERATIONS):
            points = [optimiser.ask() for _ in range(POPULATION)]
            costs = distances_of(measure, nominal, [start.scaled(p) for p in points]).mean(axis=1)
            optimiser.tell([(p, float(c)) for p, c in zip(points, costs, strict=True)])
            found[name] = max(found[name], -float(costs.min()))
    return found
