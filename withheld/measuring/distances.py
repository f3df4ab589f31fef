"""How far each fault moves the headline gap, and how much of each gap a delivered model truly closes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from spot_log import Run, read_run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array
from trainer.signals.distances import SequenceReference, wasserstein_sorted
from withheld.features import GAPS, Gap, Walk, walk_of_run
from withheld.measuring.closed_loop import simulate
from withheld.plan import Made, MakesRuns, Reality, RecordingPlan

MIN_TICKS: Final = 50
TWIN_REPEATS: Final = 3
"""Runs of each sequence by the robot without a fault; several, so that there is a floor even for a case of one run."""
SHRINK_REPEATS: Final = 3
"""Runs of each new sequence, real and simulated, for the true S."""
SMALLEST_GAP: Final = 0.25
"""In floors. A gap smaller than this above its floor cannot be shrunk by a share that means anything."""


class Written:
    """The runs of a reality that can only record: its logs lie in a folder at once.

    Args:
        reality: Which.
        plan: What it records.
        folder: Empty; the logs stay there.
    """

    def __init__(self, reality: Reality, plan: RecordingPlan, folder: Path) -> None:
        reality.record(plan, folder)
        self._folder = folder

    def walks(self, policy: Policy) -> list[Walk]:
        """Read from the logs."""
        return [walk_of_run(read_run(path), policy) for path in sorted(self._folder.glob("*.mcap"))]

    def write(self, folder: Path) -> None:
        """They are there."""


def make_runs(reality: Reality, plan: RecordingPlan, folder: Path) -> Made:
    """The runs of a plan, without logs where the reality can; ``folder`` is for those of one that cannot."""
    return reality.make_runs(plan) if isinstance(reality, MakesRuns) else Written(reality, plan, folder)


def moved(walks: Sequence[Walk], twins: Sequence[Walk]) -> float | None:
    """(D − floor)/floor: D the mean W1 + MMD between runs with and without a fault, floor that between repeats.

    None where a robot fell too soon.
    """
    first, second = by_sequence(walks), by_sequence(twins)
    ratios = []
    for name in sorted(first.keys() & second.keys()):
        repeated, others = first[name], second[name]
        if len(repeated) < len(others):
            repeated, others = others, repeated
        if len(repeated) > 1:
            ratios.append(_in_floors(name, repeated, others))
    return float(np.mean(ratios)) - 1.0 if ratios else None


class Shrunk(NamedTuple):
    """S = (D0 − D1)/(D0 − floor) of a delivered model, on runs that neither fit nor verdict saw."""

    s: float | None
    """Of the headline measure; None where the nominal model has no gap to speak of, or a robot falls."""
    gaps: dict[Gap, float]
    """Of each of the three gaps that the nominal model has."""


def true_shrink(runs: Sequence[Run], nominal: RobotModel, delivered: RobotModel, policy: Policy, seed: int) -> Shrunk:
    """How much a delivered model closes.

    Args:
        runs: New logs of the reality, several of each sequence.
        nominal: The model that the diagnosis was given.
        delivered: The model that it wrote.
        policy: In the loop.
        seed: Of the simulated runs.
    """
    real = {name: own for name, own in by_sequence([walk_of_run(run, policy) for run in runs]).items() if len(own) > 1}
    before, after = (
        by_sequence(simulate(model, policy, runs, np.random.default_rng(seed))) for model in (nominal, delivered)
    )
    gaps = {gap: _shrunk(real, before, after, partial(_w1, gap)) for gap in GAPS}
    return Shrunk(_shrunk(real, before, after, _in_floors), {gap: s for gap, s in gaps.items() if s is not None})


Walks = Mapping[str, Sequence[Walk]]
Apart = Callable[[str, Sequence[Walk], Sequence[Walk]], float]


def _shrunk(real: Walks, before: Walks, after: Walks, apart: Apart) -> float | None:
    """(D0 − D1)/(D0 − floor), each the mean over the sequences; None without a gap, or where a robot falls."""
    if not real or not real.keys() <= before.keys() & after.keys():
        return None
    d0, d1, floor = (
        float(np.mean([apart(name, own, made[name]) for name, own in real.items()])) for made in (before, after, real)
    )
    return None if d0 < (1.0 + SMALLEST_GAP) * floor else (d0 - d1) / (d0 - floor)


def _in_floors(name: str, repeated: Sequence[Walk], others: Sequence[Walk]) -> float:
    """Mean W1 + MMD over that between repeats; 1 between the repeats themselves."""
    if others is repeated:
        return 1.0
    reference = SequenceReference.build(name, [walk.features for walk in repeated])
    return float(np.mean([reference.distances(walk.features) / reference.scale for walk in others]))


def _w1(gap: Gap, _: str, repeated: Sequence[Walk], others: Sequence[Walk]) -> float:
    """Mean Wasserstein distance over pairs of different runs and over a signal's components, in its unit."""
    first, second = ([_columns(walk.signals[gap]) for walk in walks] for walks in (repeated, others))
    return float(
        np.mean(
            [
                wasserstein_sorted(a, b)
                for a, x in zip(first, repeated, strict=True)
                for b, y in zip(second, others, strict=True)
                if x is not y
            ]
        )
    )


def _columns(signal: Array) -> Array:
    """Sorted samples of each component, shape (components, ticks)."""
    return np.sort(np.ascontiguousarray(signal.T), axis=-1)


def by_sequence(walks: Sequence[Walk]) -> dict[str, list[Walk]]:
    """Runs that are long enough to be compared."""
    found: dict[str, list[Walk]] = {}
    for walk in walks:
        if len(walk.features) >= MIN_TICKS:
            found.setdefault(walk.sequence, []).append(walk)
    return found
